"""A robot in another program as a Plant, commanded by messages and predicted to when the next command acts."""

import math
import time
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from motm_twin.bus import plant_messages
from motm_twin.control.predictor import Motion, Predictor
from motm_twin.external.robot_link import NAMES, RESET_ANSWER, ClockOffset, Lead, Obedience, RobotLink
from motm_twin.model.edits import WorldEdit
from motm_twin.model.geometry import Array, compose, inverse
from motm_twin.model.plant import Actuation, Detection, Observation, Scan, Truth
from motm_twin.model.profile import DQ_MAX
from motm_twin.model.scene import PlanarPose, Scene, Task


class NotPossible(ValueError):
    """A request that this robot does not support; the message says which one and why."""


GONE = 1.0  # [s] without a state after which the robot counts as away
AGAIN = 0.5  # [s] after which a grant without an answer is sent again
SILENT_WAIT = 0.05  # [s] that a step waits for a robot that did not answer the previous grant
BEHIND = 0.2  # [s] that control may fall behind the robot's clock before it skips the missed time
LONGEST_STEP = 0.2  # [s] that a step waits at most
ROUNDING = 1e-6  # [s]
FIRST_STATES = 100  # steps of a shared clock within which a robot must send state and scan
_CLEARANCES = ("min_base_clearance", "min_arm_clearance", "min_ee_obstacle", "ee_obstacle")


def scan_of(data: plant_messages.ScanData, origin: float) -> Scan:
    """A received sweep, times counted from ``origin`` [s]."""
    return plant_messages.from_message(data, Scan, stamp=data.stamp - origin)


def detection_of(data: plant_messages.DetectionData, origin: float, T_run_odometry: Array | None = None) -> Detection:
    """A received detection in the odometry frame of the run, times counted from ``origin`` [s].

    ``T_run_odometry``: pose of a restarted robot's odometry frame in that frame; None: they are the same.
    """
    seen = plant_messages.from_message(data, Detection, stamp=data.stamp - origin)
    if T_run_odometry is None:
        return seen
    return msgspec.structs.replace(seen, odometry=compose(T_run_odometry, seen.odometry))


def truth_of(data: plant_messages.TruthData) -> Truth:
    """Received ground truth; forces stay in the robot's report."""
    clearances = {name: math.inf if (value := getattr(data, name)) is None else value for name in _CLEARANCES}
    return plant_messages.from_message(data, Truth, **clearances)


class RemoteRehearsal:
    """Pending edits, checked by the robot."""

    def __init__(self, link: RobotLink) -> None:
        self._link, self._accepted = link, list[WorldEdit]()

    def accept(self, edit: WorldEdit) -> None:
        """Add an edit to those accepted before; raises ValueError when the robot refuses it."""
        _request(self._link, edit, check=True, before=tuple(self._accepted))
        self._accepted.append(edit)


def _request(link: RobotLink, edit: WorldEdit, *, check: bool, before: tuple[WorldEdit, ...] = ()) -> None:
    request = plant_messages.EditRequest(version=plant_messages.VERSION, check=check, before=before, edit=edit)
    answer = link.ask(link.keys.edit, request)
    if not answer.ok:
        raise ValueError(answer.reason)


class ZenohPlant:
    """Drives one robot. As a ``mirror`` it only shows it: no command is ever sent, only the query for `Info`."""

    def __init__(self, link: RobotLink, scene: Scene, *, sender: str = "twin") -> None:
        """A robot that can be reset is reset to the start of the scene before it is driven."""
        self.link, self.mirror, self.scene = link, link.listen_only, scene
        self._info: plant_messages.Info | None = None
        self._sender, self._reset_wanted = sender, not self.mirror
        self._reset_refused = ""  # why the robot does not begin the run
        self._seq = time.time_ns() // 1000  # rises also across restarts of this program
        self._newest_sent = -1  # number of the newest command to this robot
        self._predictor = Predictor(scene.robot, plant_messages.HOLD)
        self._clock_sets = 0  # of the link, when the robot was adopted
        self._origin: float | None = None  # robot's clock at time 0 of the run
        self._to_odometry: Array | None = None  # `T_run_odometry` of a restarted robot
        self._clock = ClockOffset()
        self._lead = Lead(0.01)
        self._at = 0.0  # [s] robot's clock: time of this step
        self._acts_at = -np.inf  # [s] robot's clock: time of the newest observation, when its command acts
        self._latest: Observation | None = None
        self._interrupted, self._silent_since = False, 0.0
        self._arrived: list[tuple[int, float]] = []
        self._sent: dict[int, float] = {}
        self._scan: tuple[object, Scan | None] = (None, None)
        self._detections: tuple[object, tuple[Detection, ...]] = (None, ())
        self._obedience = Obedience()
        link.on_state = self._on_state

    @property
    def shared(self) -> bool:
        """True when the robot's time passes only as it is granted."""
        return self._info is not None and self._info.clock == "shared"

    def truth(self) -> Truth | None:
        """Newest ground truth; None from a robot that sends none."""
        data = self.link.newest("truth")
        return None if data is None else truth_of(data)

    def rehearsal(self) -> RemoteRehearsal:
        """A rehearsal in which the robot checks edits, one after another. Raises NotPossible."""
        self._require_editable()
        return RemoteRehearsal(self.link)

    def apply(self, edit: WorldEdit) -> None:
        """Change the world of a simulated robot; raises ValueError when it refuses."""
        self._require_editable()
        _request(self.link, edit, check=False)

    def expect_tasks(self, tasks: Sequence[Task]) -> None:
        """Tell the referee of a simulated robot the present task list."""
        self._notify(plant_messages.TaskNotice(version=plant_messages.VERSION, tasks=tuple(tasks)))

    def expect_map(self, announced: Mapping[str, PlanarPose]) -> None:
        """Tell the referee of a simulated robot the announced poses of furniture."""
        self._notify(plant_messages.TaskNotice(version=plant_messages.VERSION, announced=dict(announced)))

    def _notify(self, notice: plant_messages.TaskNotice) -> None:
        if self._info is not None and "truth" in self._info.can and not self.mirror:
            self.link.ask(self.link.keys.tasks, notice)

    def _require_editable(self) -> None:
        if self.mirror:
            raise NotPossible("a mirror only shows the robot: it changes nothing")
        if self._info is None or "edit" not in self._info.can:
            name = "there is no robot" if self._info is None else f"robot {self._info.name!r} is not simulated"
            raise NotPossible(f"{name}: its world can not be changed from here: move the real things")

    def ready(self) -> bool:
        """True when a robot can be observed now; a new one is adopted. Call it between periods."""
        if self._same() and self._origin is not None and not self._replaced():
            return self._fresh()
        return self._take_up()

    def _replaced(self) -> bool:
        """True when another robot has replaced this one. A robot that still answers was only silent."""
        if not self.link.successor:
            return False
        info = self.link.info()
        if info is None or not self._is_taken_up(info.life):
            return True
        self.link.live(info.life)
        return False

    def _same(self) -> bool:
        """True when the link listens to the adopted robot, whose clock was not set since."""
        return self._info is not None and self._is_taken_up(self.link.life)

    def _is_taken_up(self, life: str) -> bool:
        taken = None if self._info is None else (self._info.life, self._clock_sets)
        return taken == (life, self.link.clock_sets)

    def text(self) -> str:
        """One sentence about the robot."""
        if self._info is None or self._origin is None:
            return f"waiting for robot on {self.link.keys.root}/**{self._reset_refused or self._lacking()}"
        state: plant_messages.RobotState | None = self.link.newest("state")
        now = time.monotonic()
        quiet = now - self.link.last_sign
        if quiet > GONE and (self._silent_since or self.mirror or not self.shared):
            return f"waiting for robot {self._info.name!r}{self._refused() or ': nothing is heard of it'}"
        what = "shown only, not commanded"
        if not self.mirror:
            what = f"commands are given {self._lead.now(self._at) * 1e3:.0f} ms ahead"
            if state is not None and state.commander not in ("", self._sender):
                what = f"obeys somebody else: {state.commander[:80]}"
        return (
            f"robot {self._info.name!r}, {self._info.clock} clock: {what}{self._refused()}{self._obedience.text(now)}"
        )

    def _lacking(self) -> str:
        """Clause about messages that are still missing, or refused; "" when there are none."""
        if time.monotonic() - self.link.last_sign > GONE:
            return self._refused()
        if self._info is None:
            return ": hears its state, no answer on info yet"
        return "" if self.link.newest("scan") is not None else f": hears its state, no scan yet{self._refused()}"

    def _refused(self) -> str:
        """Clause about the first key whose messages are refused now, or about an intruder; "" for neither."""
        for name in NAMES:
            why = self.link.refusal(name)
            if why:
                return f": its {name} is refused: {why}"
        other = self.link.intruder
        return f": another robot (life {other[:20]!r}) sends on its keys, too, and is not listened to" if other else ""

    def observe(self) -> Observation:
        """The robot, predicted to the time at which a command given now acts; for a mirror, its newest state."""
        state: plant_messages.RobotState | None = self.link.newest("state")
        assert state is not None and self._origin is not None, "observe comes after ready"
        arrived, self._arrived = self._arrived, []
        for seq, at in arrived:
            self._lead.heard(seq, at)
        motion: Motion = plant_messages.from_message(state, Motion)
        if self.mirror:
            now = until = max(motion.stamp, self._acts_at)
        else:
            now = self._at
            until = max(now + self._lead.now(self._at), self._acts_at)
            motion = self._predictor.predict(motion, until)
        self._acts_at = until
        pose, odometry = motion.pose, motion.odometry
        if self._to_odometry is not None:
            odometry = compose(self._to_odometry, odometry)
        detections, camera_stamp = self._newest_picture()
        self._latest = Observation(
            time=until - self._origin,
            pose=pose,
            odometry=odometry,
            twist=motion.twist,
            q=motion.q,
            dq=motion.dq,
            gripper_width=state.gripper_width,
            gripper_moving=motion.gripper_moving,
            scan=self._newest_scan(until),
            detections=detections,
            camera_stamp=camera_stamp,
            ahead=until - now,
            age=self._age(state),
        )
        return self._latest

    def command(self, actuation: Actuation) -> None:
        """Send an actuation that acts from the time of the last observation on."""
        if self.mirror:
            return
        assert self._info is not None
        limits = self.scene.robot.base
        twist = np.clip(
            actuation.twist, [-limits.reverse_speed, -limits.yaw_rate], [limits.forward_speed, limits.yaw_rate]
        )
        rates = np.clip(actuation.joint_velocity, -DQ_MAX, DQ_MAX)
        self._seq += 1
        command = plant_messages.RobotCommand(
            version=plant_messages.VERSION,
            life=self._info.life,
            sender=self._sender,
            seq=self._seq,
            act_at=self._acts_at,
            twist=twist.tolist(),
            joint_velocity=rates.tolist(),
            gripper=actuation.gripper,
            opening=actuation.opening if "opening" in self._info.can else None,
            lifetime=plant_messages.HOLD,
        )
        self._newest_sent = self._seq
        within = msgspec.structs.replace(actuation, twist=twist, joint_velocity=rates)
        self._predictor.sent(self._acts_at, within)
        self._lead.sent(self._seq, self._at)
        self._sent[self._seq] = time.monotonic()
        if len(self._sent) > 500:
            del self._sent[next(iter(self._sent))]
        self.link.command(command)

    def step(self, dt: float) -> None:
        """Wait until dt [s] have passed on the robot's clock."""
        if self.shared and not self.mirror:
            self._grant(self._at + dt)
        elif self.mirror:  # until a state that is dt [s] later has come, or should have
            target, wait = self._acts_at + dt, dt if time.monotonic() - self.link.last_sign > GONE else 10.0 * dt
            with self.link.changed:
                self.link.changed.wait_for(lambda: self._reached("state", target), wait)
        else:
            self._at += dt
            behind = self._robot_now() - self._at
            if behind > BEHIND or behind < -LONGEST_STEP:  # late, or the estimate of its clock has jumped
                self._at += behind
                self._interrupted = True
            elif behind < 0.0:
                time.sleep(-behind)

    def interrupted(self) -> bool:
        """True when control paused since the last call: the robot may have stopped by itself meanwhile."""
        interrupted, self._interrupted = self._interrupted, False
        if not self.mirror and not self.shared and self._robot_now() - self._at > BEHIND:
            self._at, interrupted = self._robot_now(), True
        return interrupted

    def begin(self, scene: Scene) -> None:
        """Begin another run: a robot that can be reset starts in this scene, any other goes on from its pose."""
        if scene.robot != self.scene.robot:
            self._predictor = Predictor(scene.robot, plant_messages.HOLD)
        self.scene = scene
        self._reset_wanted = not self.mirror
        self._origin, self._to_odometry, self._reset_refused = None, None, ""
        self._latest, self._interrupted = None, False

    def _on_state(self, state: plant_messages.RobotState, received: float) -> None:
        """Process a state, in Zenoh's thread; one of a robot that is not adopted is ignored: its clock is another."""
        if not self._is_taken_up(state.life):
            return
        self._clock.state(state.stamp, received)
        if not self.mirror:
            self._obedience.state(state, received, self._seq)
        for seq, at in state.heard:
            self._arrived.append((seq, at))
            if (sent := self._sent.get(seq)) is not None:
                self._clock.command(sent, at, received)

    def _robot_now(self) -> float:
        offset = self._clock.offset
        return self._at if offset is None else time.monotonic() + offset

    def _age(self, state: plant_messages.RobotState) -> float:
        if self.shared:  # time passes only as granted: `_fresh` waits for a silent robot
            clock = self.link.newest("clock") if self.mirror else None
            return max(0.0, (self._at if clock is None else clock.stamp) - state.stamp)
        if self.mirror:
            return max(0.0, time.monotonic() - self.link.last_sign)
        return max(0.0, max(self._at, self._robot_now()) - state.stamp)

    def _newest_scan(self, now: float) -> Scan | None:
        data, origin = self.link.newest("scan"), self._origin
        assert origin is not None
        if data is None:
            return None
        if data is not self._scan[0] and data.stamp <= now + ROUNDING:
            self._scan = (data, scan_of(data, origin))
        return self._scan[1]

    def _newest_picture(self) -> tuple[tuple[Detection, ...], float | None]:
        """Detections of the newest camera frame, and its stamp [s]; None: no frame has come yet."""
        data, origin = self.link.newest("detections"), self._origin
        assert origin is not None
        if data is not None and data is not self._detections[0]:
            seen = (detection_of(one, origin, self._to_odometry) for one in data.detections)
            self._detections = (data, tuple(seen))
        return self._detections[1], None if data is None else data.stamp - origin

    def _grant(self, until: float) -> None:
        """Shared clock: grant time up to ``until`` [s], and wait for the answer."""
        wait = SILENT_WAIT if self._silent_since else 2.0 * AGAIN
        deadline = time.monotonic() + wait
        while True:
            self.link.grant(until, self._newest_sent)
            left = max(0.0, min(deadline - time.monotonic(), AGAIN))
            with self.link.changed:
                if self.link.changed.wait_for(lambda: self._reached("clock", until), left):
                    self._at, self._silent_since = self.link.newest("clock").stamp, 0.0
                    return
            if time.monotonic() >= deadline:
                self._silent_since = self._silent_since or time.monotonic() - wait
                return

    def _reached(self, name: str, until: float) -> bool:
        newest = self.link.newest(name)
        return newest is not None and newest.stamp >= until - ROUNDING

    def _answers(self) -> bool:
        """Shared clock: True when the robot answers again; messages from before its silence do not count."""
        before = self.link.newest("clock")
        self.link.grant(self._at, self._newest_sent)
        with self.link.changed:
            answers = self.link.changed.wait_for(lambda: self.link.newest("clock") is not before, SILENT_WAIT)
        if answers:
            self._silent_since, self._interrupted = 0.0, True
        return answers

    def _fresh(self) -> bool:
        """True when the robot was heard lately."""
        now = time.monotonic()
        if self.shared and not self.mirror:
            return not self._silent_since or now - self._silent_since < GONE or self._answers()
        return now - self.link.last_sign < GONE

    def _take_up(self) -> bool:
        """Adopt the robot that is there now; True when it can be observed."""
        if not self._same() or self.link.successor or self.link.newest("state") is None:
            info = self.link.info()
            if info is None:
                self._reset_refused = ""
                return False
            self._adopt(info)
        assert self._info is not None
        if self._reset_wanted and "reset" in self._info.can and not self._reset():
            return False
        self._reset_wanted = False
        return self._settle()

    def _adopt(self, info: plant_messages.Info) -> None:
        """Adopt another robot, or the same one after a restart or a set clock; forget the one before."""
        self.link.live(info.life)
        self._info, self._clock_sets = info, self.link.clock_sets
        self._predictor.clear()
        self._obedience = Obedience()
        self._clock, self._lead = ClockOffset(), Lead(info.step)
        self._arrived, self._sent, self._silent_since, self._newest_sent = [], {}, 0.0, -1
        self._scan, self._detections = (None, None), (None, ())
        if self._origin is not None:  # the run goes on
            self._origin, self._interrupted = None, True
        self._at, self._acts_at = 0.0, -np.inf

    def _reset(self) -> bool:
        request = plant_messages.ResetRequest(version=plant_messages.VERSION, scene=self.scene)
        answer = self.link.ask(self.link.keys.reset, request, RESET_ANSWER)
        self._reset_refused = "" if answer.ok else f": it refuses to begin {self.scene.name!r}: {answer.reason}"
        if not answer.ok or self._info is None:
            return False
        self.link.live(answer.life)
        info = self.link.info()
        if info is None or info.life != answer.life:
            return False
        self._adopt(info)
        return True

    def _settle(self) -> bool:
        """Begin or continue the run on the robot's clock; False while its state, scan or clock is missing."""
        if self.shared and not self.mirror:
            clock = self.link.newest("clock")
            self._at = 0.0 if clock is None else clock.stamp
            if clock is None:
                self.link.grant(0.0)  # requests its state
            for _ in range(FIRST_STATES):
                if self._shown() or self._silent_since:
                    break
                self._grant(self._at + 0.01)
        if not self._shown() or not self._fresh() or (self._clock.offset is None and not self.shared):
            return False
        state: plant_messages.RobotState = self.link.newest("state")
        if not self.shared or self.mirror:
            self._at = state.stamp if self.mirror else max(state.stamp, self._robot_now())
        before = self._latest
        self._origin = self._at - (0.0 if before is None else before.time + 0.01)
        if before is not None:
            T_world_odometry = compose(before.pose, inverse(before.odometry))
            in_odometry = compose(inverse(T_world_odometry), np.array(state.pose))
            self._to_odometry = compose(in_odometry, inverse(np.array(state.odometry)))
        self._acts_at = -np.inf
        return True

    def _shown(self) -> bool:
        return all(self.link.newest(name) is not None for name in ("state", "scan"))
