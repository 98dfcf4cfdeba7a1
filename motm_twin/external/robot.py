"""The reference robot: the simulated plant as a robot that is commanded by messages. Knows no transport and no control.

Time passes in steps of 10 ms; who calls `step` decides when.
"""

import secrets
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from motm_twin.bus.plant_messages import (
    VERSION,
    ClockReached,
    DetectionData,
    DetectionList,
    EditRequest,
    Info,
    PlantAnswer,
    ResetRequest,
    RobotState,
    ScanData,
    TaskNotice,
    TruthData,
    to_message,
)
from motm_twin.external.emulator import Link, LinkSpec
from motm_twin.external.guard import CommandGuard
from motm_twin.model.scene import Scene
from motm_twin.plants import make_plant
from motm_twin.sim.plant import SUBSTEP

TRUTH_STEPS = 5  # steps between two messages of truth: 20 Hz

Send = Callable[[str, bytes], None]  # name of the key (state, scan, ...), payload
encode = msgspec.json.Encoder().encode


class ReferenceRobot:
    """A scene with its robot and referee; messages go through an emulated link in both directions."""

    def __init__(self, scene: Scene, *, send: Send, link: LinkSpec | None = None, clock: str = "real") -> None:
        """``send`` is called for every message that leaves; ``clock``: real or shared, see `Info`."""
        self._send, self._spec, self._clock = send, link or LinkSpec(), clock
        self._physics = scene.physics  # of this robot, whatever scene a twin puts it into
        self._begin(scene)

    def _begin(self, scene: Scene) -> None:
        scene = msgspec.structs.replace(scene, physics=scene.physics or self._physics)
        self._plant = make_plant(scene)
        self.scene, self.life = scene, secrets.token_hex(6)
        self._guard = CommandGuard(self.life, scene.robot.base)
        self._up: Link[bytes] = Link(self._spec, 0)
        self._down: Link[tuple[str, bytes]] = Link(self._spec, 1)
        self._steps = 0
        self._sent: tuple[object, object] = (None, None)  # scan and detections that were sent last

    @property
    def time(self) -> float:
        """The robot's clock [s]."""
        return self._plant.time

    def info(self) -> Info:
        """Name and abilities of this robot."""
        name = f"{self.scene.robot.name}, simulated in {self.scene.name}"
        can = ["edit", "truth", "reset"]
        return Info(version=VERSION, life=self.life, name=name, clock=self._clock, step=SUBSTEP, can=can)

    def show(self) -> None:
        """Send the state of now, without any time passing."""
        self._sent = (None, None)
        self._tell()

    def command(self, payload: bytes) -> None:
        """A command leaves its sender now."""
        self._up.send(payload, self.time)

    def step(self) -> None:
        """Let 10 ms pass."""
        for payload in self._up.arrived(self.time):
            self._guard.offer(payload, self.time)
        self._plant.command(self._guard.actuation(self.time))
        self._plant.step(SUBSTEP)
        self._steps += 1
        self._tell()

    def reset(self, request: ResetRequest) -> PlantAnswer:
        """Begin again: another life."""
        try:
            self._begin(request.scene or self.scene)
        except ValueError as error:
            return PlantAnswer(version=VERSION, ok=False, life=self.life, reason=str(error))
        return PlantAnswer(version=VERSION, ok=True, life=self.life)

    def edit(self, request: EditRequest) -> PlantAnswer:
        """Change the world, or say whether it could be changed."""
        try:
            if request.check:
                rehearsal = self._plant.rehearsal()
                for edit in (*request.before, request.edit):
                    rehearsal.accept(edit)
            else:
                self._plant.apply(request.edit)
        except ValueError as error:
            return PlantAnswer(version=VERSION, ok=False, reason=str(error))
        self._truth()
        return PlantAnswer(version=VERSION, ok=True)

    def tasks(self, notice: TaskNotice) -> PlantAnswer:
        """Tell the referee the task list of now, or where furniture was announced."""
        if notice.tasks is not None:
            self._plant.expect_tasks(notice.tasks)
        if notice.announced is not None:
            self._plant.expect_map(notice.announced)
        return PlantAnswer(version=VERSION, ok=True)

    def report(self) -> dict[str, object]:
        """Counts of the referee."""
        truth = self._plant.truth()
        clearance = truth.min_base_clearance
        return {
            "scene": self.scene.name,
            "variant": self.scene.variant,
            "seed": self.scene.seed,
            "time_s": round(self.time, 3),
            "picks": truth.picks,
            "places": truth.places,
            "drops": truth.drops,
            "dropped": list(truth.dropped),
            "contacts": [msgspec.to_builtins(contact) for contact in truth.contacts],
            "contacts_caused_by_robot": sum(contact.caused_by_robot for contact in truth.contacts),
            "cut_ins": [msgspec.to_builtins(cut_in) for cut_in in truth.cut_ins],
            "min_base_clearance_m": round(clearance, 4) if np.isfinite(clearance) else None,
            "path_length_m": round(truth.path_length, 3),
            "plant_faults": list(truth.plant_faults),
            **({} if truth.physics is None else {"physics": msgspec.to_builtins(truth.physics)}),
            "commands_refused": self._guard.refused,
            "last_refusal": self._guard.refusal,
        }

    def _tell(self) -> None:
        now, plant, guard = self.time, self._plant, self._guard
        seen = plant.observe()
        if seen.scan is not None and seen.scan is not self._sent[0]:
            self._down.send(("scan", encode(to_message(seen.scan, ScanData, **self._about()))), now)
        if seen.detections is not self._sent[1]:
            detections = [to_message(one, DetectionData) for one in seen.detections]
            frame = DetectionList(**self._about(), stamp=now, detections=detections)
            self._down.send(("detections", encode(frame)), now)
        self._sent = (seen.scan, seen.detections)
        state = to_message(
            seen,
            RobotState,
            **self._about(),
            seq=self._steps,
            stamp=now,
            heard=guard.heard(),
            commander=guard.commander,
            refused=guard.refused,
            refusal=guard.refusal,
        )
        self._down.send(("state", encode(state)), now)
        for name, payload in self._down.arrived(now):
            self._send(name, payload)
        if self._steps % TRUTH_STEPS == 0:
            self._truth()
        if self._clock == "shared":
            self._send("clock", encode(ClockReached(**self._about(), stamp=now)))

    def _truth(self) -> None:
        self._send("truth", encode(to_message(self._plant.truth(), TruthData, **self._about(), stamp=self.time)))

    def _about(self) -> dict[str, Any]:
        return {"version": VERSION, "life": self.life}
