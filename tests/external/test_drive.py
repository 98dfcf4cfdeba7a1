"""A twin that drives a robot in another program: the same as in one, late, silent, hostile, two at once, mirrored."""

import secrets
import time

import msgspec
import numpy as np
import pytest
import zenoh
from meeting import STATE, driven, running_robot
from waiting import until

from motm_twin.bus.connection import PlantKeys, open_member
from motm_twin.bus.plant_messages import VERSION, ClockGrant, PlantAnswer, RobotCommand
from motm_twin.external.plant import ZenohPlant
from motm_twin.external.robot import LinkSpec
from motm_twin.external.robot_link import RobotLink
from motm_twin.model.edits import AddObstacle, Announce, MoveObject
from motm_twin.model.scene_file import load_scene
from motm_twin.model.scene_shapes import pieces
from motm_twin.twin import Twin

BOX = AddObstacle(name="box", x=0.0, y=-2.0)


def same(one, other):
    """Whether two periods saw, decided and caused the same."""
    pairs = [
        (one.observation.pose, other.observation.pose),
        (one.observation.q, other.observation.q),
        (one.arm[-1].actuation.twist, other.arm[-1].actuation.twist),
        (one.arm[-1].actuation.joint_velocity, other.arm[-1].actuation.joint_velocity),
        (one.truth.pose, other.truth.pose),
    ]
    return one.time == other.time and all(np.array_equal(a, b) for a, b in pairs)


@pytest.mark.parametrize("name", [("exp1", "trial1"), ("barn:0",)])  # the last has no arm
def test_over_a_perfect_link_the_run_is_the_same_bit_for_bit(router, name):
    scene = load_scene(*name)
    inside = Twin(scene)
    with running_robot(router, scene), driven(router, scene) as outside:
        for _ in range(40):
            assert same(inside.advance(), outside.advance())


def test_two_twins_and_two_robots_on_one_router_do_not_disturb_each_other(router, scene):
    other = load_scene("exp1", "trial2")
    inside = {"left": Twin(scene), "right": Twin(other)}
    with (
        running_robot(router, scene, twin="left"),
        running_robot(router, other, twin="right"),
        driven(router, scene, twin="left") as left,
        driven(router, other, twin="right") as right,
    ):
        for _ in range(20):
            assert same(inside["left"].advance(), left.advance())
            assert same(inside["right"].advance(), right.advance())


def test_over_a_bad_link_it_acts_ahead_and_keeps_driving(router, scene):
    link = LinkSpec(latency=0.05, jitter=0.02, loss=0.01, seed=1)
    with running_robot(router, scene, link=link) as robot, driven(router, scene) as twin:
        ticks = [twin.advance() for _ in range(100)]
        report = robot.robot.report()
    assert report["path_length_m"] > 0.5
    assert report["contacts"] == []
    assert 0.05 <= ticks[-1].observation.ahead <= 0.1
    errors = _errors(ticks)
    assert len(errors) > 50
    assert max(errors) < 0.03  # the noise of localisation is in it


def _errors(ticks):
    """How far [m] the base was, at the times of which there is truth, from where it had been expected to be."""
    truth = {}
    for tick in ticks:
        end = tick.observation.time - tick.observation.ahead + 0.05  # truth of a period is of its end
        truth[round(end, 3)] = tick.truth.pose
    expected = [sample for tick in ticks[20:] for sample in tick.samples if round(sample.time, 3) in truth]
    return [float(np.hypot(*(seen.pose - truth[round(seen.time, 3)])[:2])) for seen in expected]


@pytest.mark.parametrize("trouble", ["late", "lost"])
def test_a_hand_that_hears_nothing_as_it_sinks_does_not_touch_the_table(router, scene, trouble):
    """It went 3 cm into it: on a busy machine, and over a network, a robot hears nothing for a moment now and then."""
    good = LinkSpec(latency=0.02)
    bad = LinkSpec(latency=0.17) if trouble == "late" else LinkSpec(latency=0.02, loss=1.0)
    with running_robot(router, scene, link=good) as robot, driven(router, scene) as twin:
        final = 0
        for _ in range(200):
            final += twin.advance().arm[-1].phase == "final"
            if final == 4:
                break
        assert final == 4, "no grasp"
        robot.impair(bad)
        for _ in range(6):
            twin.advance()
        robot.impair(good)
        for _ in range(24):
            twin.advance()
        report = robot.robot.report()
    assert report["contacts"] == []


def test_late_states_slow_then_stop_and_it_goes_on_by_itself(router, scene):
    with running_robot(router, scene) as robot, driven(router, scene) as twin:
        for _ in range(30):
            assert "old" not in twin.advance().stop_reason
        robot.muted = frozenset({"state", "scan", "detections"})
        reasons = [twin.advance().stop_reason for _ in range(30)]
        slowed = [k for k, reason in enumerate(reasons) if reason.startswith("slowed to half speed: the newest")]
        stopped = [k for k, reason in enumerate(reasons) if reason.startswith("stopped: the newest")]
        assert slowed and stopped
        assert max(slowed) < min(stopped)
        before = robot.robot.report()
        twin.advance()
        standing = robot.robot.report()
        assert standing["path_length_m"] == before["path_length_m"]
        robot.muted = frozenset()
        again = [twin.advance() for _ in range(40)]
        after = robot.robot.report()
    assert "old" not in again[-1].stop_reason
    assert after["path_length_m"] > before["path_length_m"] + 0.1


@pytest.mark.parametrize("silent", ["scan", "state"])
def test_one_silent_sensor_is_enough_to_stop(router, scene, silent):
    names = {"scan": "lidar scan", "state": "state of the robot"}
    with running_robot(router, scene) as robot, driven(router, scene) as twin:
        for _ in range(5):
            twin.advance()
        robot.muted = frozenset({silent})
        reasons = [twin.advance().stop_reason for _ in range(10)]
    assert f"stopped: the newest {names[silent]} is" in reasons[-1]


def test_a_camera_that_falls_silent_is_told_also_when_it_had_shown_nothing(router, scene):
    """Pictures that show nothing were not sent, so nobody could tell them from a camera that is off."""
    with running_robot(router, scene) as robot, driven(router, scene) as twin:
        shown = [twin.advance() for _ in range(20)]
        robot.muted = frozenset({"detections"})
        silent = [twin.advance() for _ in range(10)]
    assert not shown[-1].observation.detections and shown[-1].stop_reason == ""
    assert silent[-1].stop_reason.startswith("the camera's newest picture is")


def test_what_a_waiting_twin_lacks_is_told(router, scene):
    keys, life = PlantKeys("frankie"), {"version": VERSION, "life": "1"}
    link = RobotLink(router.session, "frankie")
    plant = ZenohPlant(link, scene)

    def told(text):
        robot.put(keys.state, msgspec.json.encode(STATE | life))
        assert not plant.ready()
        return plant.text() == text

    with open_member(router.endpoint) as robot:
        waiting = "waiting for robot on motm/frankie/plant/**"
        assert plant.text() == waiting
        until(lambda: told(f"{waiting}: hears its state, no answer on info yet"))
        info = msgspec.json.encode(life | {"name": "blind"})
        with robot.declare_queryable(keys.info, lambda query: query.reply(keys.info, info)):
            until(lambda: told(f"{waiting}: hears its state, no scan yet"))
    link.close()


def test_a_robot_that_refuses_the_reset_is_waited_for_with_its_reason_and_its_time_passes(router, scene, monkeypatch):
    """The status said only what was waited for; every refused reset set the robot's clock back, so that it stood."""
    with running_robot(router, scene, clock="real") as server:
        link = RobotLink(router.session, "frankie")
        plant = ZenohPlant(link, scene)
        refusal = PlantAnswer(version=VERSION, ok=False, reason="it needs pyrvo")
        monkeypatch.setattr(server.robot, "reset", lambda request: refusal)
        told = f"waiting for robot on motm/frankie/plant/**: it refuses to begin {scene.name!r}: it needs pyrvo"
        until(lambda: not plant.ready() and plant.text() == told)
        before = server.robot.time
        until(lambda: not plant.ready() and server.robot.time > before + 0.5)
        monkeypatch.undo()
        until(plant.ready)
        assert "refuses" not in plant.text()
        link.close()


def test_a_robot_without_a_twin_stops_by_itself(robot, twin):
    while twin.advance().observation.twist[0] < 0.2:
        pass
    for _ in range(150):  # nobody commands: only time is granted
        twin.plant.step(0.01)
    before = robot.robot.report()
    twin.plant.step(0.01)
    after = robot.robot.report()
    assert after["path_length_m"] == before["path_length_m"]
    assert not after["plant_faults"]


def test_a_grant_that_overtakes_its_command_waits_for_it_but_not_for_ever(router, scene):
    keys = PlantKeys()

    def grant(until_time, after):
        life = robot.robot.life
        granted = ClockGrant(version=VERSION, life=life, until=until_time, after=after)
        router.session.put(keys.grant, msgspec.json.encode(granted))

    with running_robot(router, scene) as robot:
        until(lambda: robot.robot.time == 0.0 and robot._session is not None)
        until(lambda: any(reply.ok for reply in router.session.get(keys.info, timeout=1.0)))
        grant(0.01, after=7)
        time.sleep(0.1)
        assert robot.robot.time == 0.0
        command = RobotCommand(
            version=VERSION, life=robot.robot.life, sender="twin", seq=7, act_at=0.0, twist=[0.1, 0.0],
            joint_velocity=[0.0] * 7, gripper="open",
        )  # fmt: skip
        router.session.put(keys.command, msgspec.json.encode(command))
        until(lambda: robot.robot.time == pytest.approx(0.01))
        assert robot.robot._guard.commander == "twin"
        grant(0.02, after=8)
        until(lambda: robot.robot.time == pytest.approx(0.02))  # that command was lost


def test_by_a_shared_clock_nothing_grows_old_while_the_robot_is_silent_which_is_noticed(robot, twin):
    plant = twin.external
    for _ in range(3):
        twin.advance()
    robot.muted = frozenset({"state", "scan", "detections", "clock", "truth"})
    before = plant.observe()
    plant.step(0.01)
    seen = plant.observe()
    assert (seen.time, seen.age) == (before.time, before.age)
    assert not plant.ready()
    assert "waiting for robot" in plant.text()
    robot.muted = frozenset()
    until(plant.ready)
    assert "waiting" not in plant.text()


def test_edits_go_to_a_simulated_robot_and_are_refused_by_it(twin):
    twin.advance()
    twin.post(BOX)
    with pytest.raises(ValueError, match="box"):
        twin.post(BOX)
    tick = twin.advance()
    assert [body.name for body in tick.truth.obstacles] == ["box"]


def test_an_edit_that_is_refused_only_when_its_period_comes_is_told_and_not_logged(twin):
    twin.advance()
    twin.post(BOX)
    twin.plant.apply(BOX)  # the robot's world has moved on
    tick = twin.advance()
    (told,) = twin.refused
    assert told.startswith("the robot has refused add_obstacle box: ")
    assert (tick.edits, twin.edits) == ((), [])
    twin.advance()
    assert twin.refused == []


def test_a_robot_that_is_not_simulated_refuses_edits_with_a_sentence(router, scene):
    with running_robot(router, scene) as robot:
        plain = robot.robot.info()
        robot.robot.info = lambda: msgspec.structs.replace(plain, life=robot.robot.life, can=[])  # type: ignore[method-assign]
        robot.muted = frozenset({"truth"})
        with driven(router, scene) as twin:
            tick = twin.advance()
            assert tick.truth is None
            for edit in (BOX, MoveObject(name="cube_L", x=1.0, y=1.0)):
                with pytest.raises(ValueError, match="not simulated: its world can not be changed"):
                    twin.post(edit)
            with pytest.raises(ValueError, match="does not tell"):
                twin.post(Announce(name=next(name for name, piece in pieces(scene).items() if piece.mapped)))
            with pytest.raises(ValueError, match="record the run"):
                twin.session()
            with pytest.raises(ValueError, match="can not go back"):
                twin.restore(twin.snapshot())
            twin.reset()
            until(twin.external.ready)
            assert twin.advance().index == 0


def test_hostile_messages_disturb_neither_side(router, scene):
    inside, keys = Twin(scene), PlantKeys()
    everywhere = (keys.state, keys.scan, keys.detections, keys.truth, keys.clock, keys.command, keys.grant)
    command = RobotCommand(
        version=VERSION, life="other", sender="foe", seq=1, act_at=0.0, twist=[0.1, 0.0], joint_velocity=[0.0] * 7,
        gripper="open",
    )  # fmt: skip
    rubbish = [b"", b"{}", b"[" * 5000, secrets.token_bytes(200), msgspec.json.encode(command), b"\xff" * 2_000_000]
    with running_robot(router, scene) as robot, driven(router, scene) as outside:
        for _ in range(10):
            for key in everywhere:
                for payload in rubbish:
                    router.session.put(key, payload)
            for key in (keys.reset, keys.edit, keys.tasks):
                for payload in rubbish[:5]:
                    for reply in router.session.get(key, payload=payload, timeout=5.0):
                        assert reply.ok is not None
                        assert b'"ok":false' in reply.ok.payload.to_bytes()
            assert same(inside.advance(), outside.advance())
        report = robot.robot.report()
    assert report["commands_refused"] >= 50


def test_a_mirror_shows_the_robot_and_never_says_anything(router, scene):
    heard = []
    keys = PlantKeys()
    spies = [
        router.session.declare_subscriber(key, zenoh.handlers.Callback(lambda s: heard.append(str(s.key_expr))))
        for key in (keys.command, keys.grant)
    ]
    idle = msgspec.structs.replace(scene, tasks=())
    with running_robot(router, scene, clock="real") as robot, driven(router, idle, mirror=True) as twin:
        life = robot.robot.life
        ticks = [twin.advance() for _ in range(30)]
        assert robot.robot.life == life  # it was not reset
        report = robot.robot.report()
        with pytest.raises(ValueError, match="mirror"):
            twin.post(BOX)
    for spy in spies:
        spy.undeclare()
    assert heard == []
    assert report["commands_refused"] == 0
    assert report["path_length_m"] == 0.0
    assert ticks[-1].time > ticks[0].time
    assert len(ticks[-1].beliefs) == len(scene.objects)
    assert ticks[-1].observation.scan is not None
