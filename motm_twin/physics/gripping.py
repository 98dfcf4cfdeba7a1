"""The gripper's drive: speed of the commanded width, and detection of a held object."""

import math

import msgspec
import numpy as np

from motm_twin.model.exact import norm, product, transposed_times
from motm_twin.model.geometry import Array
from motm_twin.model.plant import GraspTruth
from motm_twin.model.profile import Gripper as GripperSpec
from motm_twin.model.scene import Physics
from motm_twin.physics.forces import Contacts, Grasp
from motm_twin.sim.gripper import GripperState, open_width
from motm_twin.sim.plant_state import PlantState

USUAL_SIDE = 0.04  # [m] of an object, where a scene has none
FIRM = 0.6  # share of the grip force with which both pads must press
BUILD_UP = 0.06  # [s] from the first touch to that force
BEYOND = 0.012  # [m] largest lead of the commanded width over the fingers: enough for full force
PRESSING = 4.0  # factor on the closing speed once the fingers stand, so that the force grows faster
STANDS = 2e-4  # [m] per substep: slower fingers stand
STOOD = 4  # such slow substeps after which the grip is judged
LOOSE = 3  # substeps after which an object that is not pressed by both pads is no longer held
OPEN = 1e-3  # [m] from the open width within which the fingers are open; from 0: closed on nothing


class Fingers:
    """Drives the width between the pads with limited force, and finds what the fingers hold."""

    def __init__(self, spec: GripperSpec, physics: Physics, sides: list[float], dt: float) -> None:
        """``sides`` [m] of the scene's objects; substeps of dt [s].

        The fingers are just fast enough to hold an object of mean side firmly after the closing time.
        """
        side = float(np.mean(sides)) if sides else USUAL_SIDE
        self.spec, self._dt = spec, dt
        closing = max(spec.closing_time - BUILD_UP, dt)
        self.closing_speed = max(spec.max_width - side, 0.01) / closing  # [m/s] of the width
        self.opening_speed = max(spec.max_width - side, 0.01) / max(spec.opening_time, dt)
        self._wait = round(physics.closing_delay / dt)
        self._firm = FIRM * physics.grip_force

    def command(self, s: PlantState, now: float) -> None:
        """Begin to close or open, as the plant's changed command says; ``now`` [s]."""
        state, grasp, command = s.gripper, s.physics.grasp, s.gripper_command
        if command == "close" and state.phase in ("open", "opening"):
            state.phase, state.outcome, grasp.waits = "closing", "nothing", self._wait
            grasp.began, grasp.speed = now, 0.0
            grasp.places = {item.name: item.position.copy() for item in s.objects}
        elif command == "open" and (
            state.phase in ("closing", "closed") or state.width != open_width(state, self.spec)
        ):
            state.phase, grasp.waits = "opening", 0
        state.began, state.start_width, grasp.still = now, state.width, 0

    def reference(self, state: GripperState, grasp: Grasp, *, stuck: bool) -> None:
        """Advance the commanded width by a substep; ``stuck``: it stays."""
        if stuck:
            return
        if state.phase in ("closing", "closed"):
            if grasp.waits > 0:
                grasp.waits -= 1
                return
            ahead = max(state.width - BEYOND, 0.0)
            speed = self.closing_speed * (1.0 if grasp.still < 2 else PRESSING)  # fingers that stand press harder
            grasp.width = max(grasp.width - speed * self._dt, ahead)
        else:
            step, wide = self.opening_speed * self._dt, open_width(state, self.spec)
            grasp.width = max(grasp.width - step, min(max(grasp.width, state.width) + step, wide))

    def read(self, s: PlantState, hand: Array, width: float, contacts: Contacts, now: float, tcp_speed: float) -> None:
        """Update the phase of the fingers, and the object that they hold.

        ``hand``: its transform; ``width`` [m] between the pads; ``tcp_speed`` [m/s].
        """
        state, grasp = s.gripper, s.physics.grasp
        was = state.held
        moved, state.width = abs(width - state.width), width
        grasp.still = grasp.still + 1 if moved < STANDS else 0
        grasp.pressed, grasp.forces = contacts.pinched
        if state.phase == "closing":
            grasp.speed = max(grasp.speed, tcp_speed)
            self._close(s, now)
        elif state.phase == "opening":
            state.held = "" if not grasp.pressed else state.held
            wide = open_width(state, self.spec)
            if width > wide - OPEN and (wide == self.spec.max_width or width < wide + OPEN):
                state.phase, state.held = "open", ""
        if state.held:
            self._carry(s, hand)
        if was and not state.held:
            grasp.done[-1] = msgspec.structs.replace(grasp.done[-1], lost=state.outcome == "dropped")
            grasp.taken = None

    @staticmethod
    def _carry(s: PlantState, hand: Array) -> None:
        state, grasp = s.gripper, s.physics.grasp
        grasp.loose = 0 if grasp.pressed == state.held else grasp.loose + 1
        if grasp.loose >= LOOSE:
            state.outcome = "dropped" if state.phase == "closed" else state.outcome
            state.held, grasp.loose = "", 0
            if state.phase == "closed":
                state.phase = "closing"
            return
        item = next(item for item in s.objects if item.name == state.held)
        state.position_in_hand = transposed_times(hand[:3, :3], item.position - hand[:3, 3])
        state.rotation_in_hand = product(hand[:3, :3].T.copy(), item.rotation)
        if grasp.taken is None:
            grasp.taken = state.position_in_hand, state.rotation_in_hand
        slip = norm(state.position_in_hand - grasp.taken[0])
        turned = product(state.rotation_in_hand, grasp.taken[1].T.copy())
        turn = math.acos(max(-1.0, min(1.0, 0.5 * (float(np.trace(turned)) - 1.0))))
        newest = grasp.done[-1]
        if state.phase == "closed":
            grasp.done[-1] = msgspec.structs.replace(newest, slip=max(newest.slip, slip), turn=max(newest.turn, turn))

    def _close(self, s: PlantState, now: float) -> None:
        state, grasp = s.gripper, s.physics.grasp
        stands = grasp.still >= STOOD
        if grasp.pressed and stands and min(grasp.forces) >= self._firm:
            item = next(item for item in s.objects if item.name == grasp.pressed)
            state.phase, state.held, state.outcome = "closed", item.name, "held"
            state.held_from_z, grasp.loose = float(item.position[2]), 0
            shift = norm(item.position - grasp.places[item.name])
            new = GraspTruth(
                object=item.name, time=grasp.began, firm=now - grasp.began, shift=shift, speed=grasp.speed, slip=0.0,
                turn=0.0,
            )  # fmt: skip
            grasp.done, grasp.taken = [*grasp.done, new], None
        elif stands and state.width < OPEN:
            state.phase = "closed"
