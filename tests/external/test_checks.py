"""What a robot sends that can not be used: it does not count, the twin says why, and goes on with what can."""

import itertools
import math
import re
import threading
import time
from collections import deque
from contextlib import closing

import msgspec
import pytest
from meeting import STATE, driven
from waiting import until

from motm_twin.bus.connection import PlantKeys, open_member
from motm_twin.bus.plant_messages import VERSION, RobotCommand
from motm_twin.external.robot_link import MAX_BYTES, RefusedMessage, RobotLink, read

SCAN = {"version": VERSION, "life": "1", "stamp": 5.0, "pose": [0.0] * 3, "origin": [0.0] * 2, "angle_min": -3.0,
        "angle_step": 0.1, "range_min": 0.1, "range_max": 10.0, "ranges": [None]}  # fmt: skip
SEEN = {"stamp": 5.0, "name": "cube", "p_base": [0.6, 0.0, 0.8], "yaw_base": 0.0, "position_sd": 0.002,
        "odometry": [0.0] * 3}  # fmt: skip
SIGHT = {"version": VERSION, "life": "1", "stamp": 5.0, "detections": [SEEN]}


def encoded(message, **changed):
    """As it travels, with some fields changed, or left out (None)."""
    return msgspec.json.encode({key: value for key, value in (message | changed).items() if value is not None})


@pytest.mark.parametrize(("name", "message"), [("state", STATE), ("scan", SCAN), ("detections", SIGHT)])
def test_what_is_as_documented_is_read(name, message):
    assert read(name, encoded(message)).life == "1"


@pytest.mark.parametrize(
    ("name", "message", "changed", "why"),
    [
        ("state", STATE, {"q": [0.0] * 6}, "q needs 7 finite numbers, and has [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]"),
        ("state", STATE, {"dq": [0.0] * 100}, "dq needs 7 finite numbers, and has 100"),
        ("state", STATE, {"pose": [0.0] * 2}, "pose needs 3 finite numbers"),
        ("state", STATE, {"odometry": [0.0] * 4}, "odometry needs 3 finite numbers"),
        ("state", STATE, {"twist": [0.0] * 3}, "twist needs 2 finite numbers"),
        ("state", STATE, {"pose": [1e9, 0.0, 0.0]}, "pose has 1e+09: -100000 to 100000 m can be"),
        ("state", STATE, {"q": [0.0] * 6 + [-45.0]}, "q has -45: -10 to 10 rad can be"),
        ("state", STATE, {"gripper_width": -5.0}, "gripper_width has -5: -0.01 to 1 m can be"),
        ("state", STATE, {"q": None}, "Object missing required field `q`"),
        ("state", STATE, {"version": "motm.plant/2"}, "version 'motm.plant/2': this twin reads 'motm.plant/1'"),
        ("state", STATE, {"stamp": 1e308}, "stamp has 1e+308: 1e+11 at most can be"),
        ("state", STATE, {"seq": 2**60}, "seq has a whole number of 61 bits: 9.0072e+15 at most can be"),
        ("state", STATE, {"seq": 10**400}, "seq has a whole number of 1329 bits"),
        ("state", STATE, {"odometry": [0.0, 0.0, -1e300]}, "odometry has -1e+300"),
        ("state", STATE, {"heard": [[1, 1e200]]}, "heard has 1e+200"),
        ("scan", SCAN, {"stamp": -1e308}, "stamp has -1e+308"),
        ("scan", SCAN, {"angle_min": 1e300}, "angle_min has 1e+300"),
        ("scan", SCAN, {"origin": [0.0] * 3}, "origin needs 2 finite numbers"),
        ("scan", SCAN, {"pose": [0.0, 1e9, 0.0]}, "pose has 1e+09"),
        ("detections", SIGHT, {"detections": [SEEN | {"p_base": [0.0]}]}, "p_base of 'cube' needs 3 finite numbers"),
        ("detections", SIGHT, {"detections": [SEEN | {"stamp": 9.0}]}, "stamp of 'cube' is 4.0 s after its picture"),
        ("detections", SIGHT, {"detections": [SEEN | {"yaw_base": 1e200}]}, "yaw_base has 1e+200"),
        ("detections", SIGHT, {"detections": [SEEN | {"position_sd": -1.0}]}, "position_sd of 'cube' is -1 m"),
    ],
)
def test_what_can_not_be_used_is_refused_with_a_reason(name, message, changed, why):
    with pytest.raises(RefusedMessage) as refusal:
        read(name, encoded(message, **changed))
    assert str(refusal.value).startswith(why)


@pytest.mark.parametrize("payload", [b"", b"\xff\xfe", b"[" * 100_000, b'{"q": NaN}', b"1" * (MAX_BYTES + 1)])
def test_what_is_no_message_is_refused(payload):
    with pytest.raises(RefusedMessage):
        read("state", payload)


@pytest.fixture
def talk(router):
    """A link, and a function that sends it a message, once, and waits until it is in."""
    link, keys = RobotLink(router.session, "frankie", listen_only=True), PlantKeys("frankie")
    with open_member(router.endpoint) as robot:

        def put(name, message):
            robot.put(getattr(keys, name), encoded(message))
            return True

        for name, message in (("state", STATE), ("scan", SCAN)):  # until the way is there; of another life
            until(lambda name=name, message=message: put(name, message | {"life": "0"}) and link.newest(name))
        put("state", STATE | {"life": "0", "seq": 1})  # the last of them: nothing comes after it by itself
        until(lambda: link.newest("state").seq == 1)
        link.live("1")

        def send(name, message, **changed):
            before = link.unreadable, link.newest(name)
            put(name, message | changed)
            until(lambda: link.unreadable != before[0] or link.newest(name) is not before[1])
            return link

        yield send
    link.close()


def test_a_scan_from_the_future_is_refused_and_the_next_one_counts(talk):
    talk("state", STATE)
    link = talk("scan", SCAN, stamp=1e6)
    assert link.refusal("scan").startswith("its stamp is 99999")
    assert talk("scan", SCAN, stamp=5.05).newest("scan").stamp == 5.05
    assert link.refusal("scan") == ""


def test_a_scan_from_the_future_before_any_state_does_not_keep_later_ones_out(talk):
    assert talk("scan", SCAN, stamp=1e6).newest("scan").stamp == 1e6  # the first of its life
    talk("state", STATE)
    assert talk("scan", SCAN, stamp=5.05).newest("scan").stamp == 5.05


def test_states_with_a_wrong_stamp_are_not_believed(talk):
    talk("state", STATE)
    for stamp in (1e6, 1e6, -1e6):
        link = talk("state", STATE, stamp=stamp)
        assert "its stamp jumps by" in link.refusal("state") and link.newest("state").stamp == 5.0
    assert talk("state", STATE, stamp=5.01).newest("state").stamp == 5.01
    assert (link.refusal("state"), link.clock_sets) == ("", 0)


@pytest.mark.parametrize("jump", [-50.0, 50.0])
def test_a_clock_that_was_set_is_believed_after_a_silence(talk, jump):
    talk("scan", SCAN, stamp=99.9)
    talk("state", STATE, stamp=100.0)
    link = talk("state", STATE, stamp=100.0 + jump)
    later = itertools.count(1)
    until(lambda: talk("state", STATE, stamp=100.0 + jump + 0.05 * next(later)).clock_sets == 1)
    assert abs(link.newest("state").stamp - 100.0 - jump) < 5.0
    assert link.newest("scan") is None, "of the other clock"
    assert talk("scan", SCAN, stamp=link.newest("state").stamp).newest("scan") is not None


def test_a_scan_without_a_new_state_is_taken_for_as_long_as_time_has_passed(talk):
    link = talk("state", STATE)
    link.last_sign -= 3.0
    assert talk("scan", SCAN, stamp=8.0).refusal("scan") == ""


def test_a_robot_that_errs_stands_says_why_and_drives_on(router, robot, twin):
    for _ in range(5):
        twin.advance()
    newest = msgspec.to_builtins(twin.external.link.newest("state"))
    robot.muted = frozenset({"state"})
    reasons = []
    for step in range(12):
        router.session.put(PlantKeys().state, encoded(newest, q=[0.0] * 6, stamp=newest["stamp"] + 0.05 * step))
        reasons.append(twin.advance().stop_reason)
    assert "stopped: the newest state of the robot is" in reasons[-1]
    assert twin.external.text().endswith("its state is refused: q needs 7 finite numbers, and has " + str([0.0] * 6))
    robot.muted = frozenset()
    again = [twin.advance() for _ in range(10)]
    assert again[-1].stop_reason == "" and math.isfinite(again[-1].observation.q.sum())
    assert "refused" not in twin.external.text()


class Skewed:
    """A robot that stands, whose clock can be set; it remembers for when its commands were."""

    def __init__(self, session, beams):
        self.offset, self.acts, self._beams = 100.0, deque(maxlen=5), beams
        self._session, self._keys, self._born, self._over = session, PlantKeys("frankie"), time.monotonic(), False
        self._heard = []
        info = msgspec.json.encode({"version": VERSION, "life": "1", "name": "skewed"})
        self._declared = (
            session.declare_subscriber(self._keys.command, self._on_command),
            session.declare_queryable(self._keys.info, lambda query: query.reply(self._keys.info, info)),
        )
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def now(self):
        """Its clock [s]."""
        return time.monotonic() - self._born + self.offset

    def close(self):
        """Say nothing more."""
        self._over = True
        self._thread.join()
        for declared in self._declared:
            declared.undeclare()

    def _on_command(self, sample):
        command = msgspec.json.decode(sample.payload.to_bytes(), type=RobotCommand)
        self._heard.append((command.seq, self.now()))
        self.acts.append(command.act_at - self.now())

    def _run(self):
        for seq in itertools.count():
            if self._over:
                return
            heard, self._heard = self._heard, []
            self._session.put(self._keys.state, encoded(STATE, seq=seq, stamp=self.now(), heard=heard))
            if seq % 5 == 0:
                ranges = [5.0] * self._beams
                self._session.put(self._keys.scan, encoded(SCAN, stamp=self.now(), ranges=ranges, angle_step=0.008))
            time.sleep(0.01)


@pytest.fixture
def skewed(router, scene):
    """Such a robot, and the twin that drives it."""
    with open_member(router.endpoint) as session, closing(Skewed(session, scene.robot.lidar.beams)) as robot:
        with driven(router, scene) as twin:
            yield robot, twin


def test_a_clock_that_was_set_in_the_middle_of_a_period_does_not_set_the_run(skewed):
    """Nobody asks whether it is ready: as in a period in which the robot's new clock begins to count."""
    robot, twin = skewed
    for _ in range(20):
        tick = twin.advance()
    began, before = time.monotonic(), tick.time
    robot.offset += 50.0
    until(lambda: twin.advance() and twin.external.link.clock_sets == 1)
    assert 0.0 < twin.advance().time - before < time.monotonic() - began + 1.0


@pytest.mark.parametrize("jump", [-50.0, 50.0])
def test_a_robot_whose_clock_was_set_is_taken_up_again_and_the_run_goes_on(skewed, jump):
    robot, twin = skewed
    periods, told = [], set()  # [s] of the run, begin and end by a clock that nobody sets; texts

    def advanced():
        began = time.monotonic()
        tick = twin.advance()
        periods.append((tick.time, began, time.monotonic()))
        return tick

    for _ in range(20):
        advanced()
    robot.offset += jump
    while twin.external.ready():
        advanced()
        told.add(twin.external.text())
    assert any("its state is refused: its stamp jumps by" in text for text in told), told
    until(twin.external.ready)
    robot.acts.clear()
    ticks = [advanced() for _ in range(20)]
    for (earlier, began, _), (later, _, ended) in itertools.pairwise(periods):
        assert 0.0 < later - earlier < ended - began + 1.0, "time goes on, by no more than has passed"
    ages = [float(age) for tick in ticks[-10:] for age in re.findall(r"([\d.]+) s old", tick.stop_reason)]
    assert max(ages, default=0.0) < 1.0, "an age is reckoned by the clock as it was"
    assert max(abs(ahead) for ahead in robot.acts) < 0.3, "commands are for times of the new clock"
