"""The parallel gripper: pads that take time to close and open, and the cube between them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from motm_twin.model.arm_kernels import HAND, TCP
from motm_twin.model.exact import dot, norm, product, times, transposed_times
from motm_twin.model.geometry import Array
from motm_twin.model.profile import Gripper as GripperSpec
from motm_twin.model.state import LATER
from motm_twin.sim import grasp
from motm_twin.sim.grasp import RELATIVE_SPEED, STRICT
from motm_twin.sim.objects import ObjectState, ObjectWorld
from motm_twin.sim.solids import Solids

SLIP_HEIGHT = 0.01  # [m] lift after which a cube that slid between the closing pads slips out
EPSILON = 1e-9  # [s]


@dataclass
class GripperState:
    """Pads, and the cube between them."""

    width: float  # [m]
    phase: str = "open"  # open | closing | closed | opening
    opening: float | None = field(default=None, metadata=LATER)  # [m] when open; None: all the way
    began: float = 0.0  # [s] when the phase began
    start_width: float = 0.0  # [m] width at that time
    candidate: str = ""  # cube that has met the grasp rule since closing began
    slid: bool = False  # the candidate has moved too fast relative to the hand
    held: str = ""
    held_from_z: float = 0.0  # [m] height at which the cube was grasped
    outcome: str = ""  # newest closing: held | slipping | nothing | offset | yaw | tilt | no room | dropped | taken
    under: tuple[str, ...] = field(default=(), metadata=LATER)  # cubes that a finger stands on or wedges
    moment: float = field(default=0.0, metadata=LATER)  # [m^2] of pushes by a single pad while closing
    along: float = field(default=0.0, metadata=LATER)  # [m] of the candidate along the pads, until both touch it
    position_in_hand: Array = field(default_factory=lambda: np.zeros(3))  # of the held cube
    rotation_in_hand: Array = field(default_factory=lambda: np.eye(3))


def open_width(state: GripperState, spec: GripperSpec) -> float:
    """Width [m] to which the fingers open: as commanded, or all the way when they hold a cube."""
    return spec.max_width if state.opening is None or state.held else min(state.opening, spec.max_width)


class Hand(NamedTuple):
    """The hand at the end of a substep, world frame."""

    tcp: Array  # tool centre point [m], shape (3,)
    rotation: Array  # shape (3, 3)
    place: Array  # position of its frame [m], shape (3,)
    velocity: Array  # of the tool centre point [m/s], shape (3,)


class Gripper:
    """Grasps by geometry: the rule of `grasp` must hold from the command to the firm hold.

    A cube that slides too fast is held loosely and slips when lifted; a misaligned one is squeezed out.
    """

    def __init__(
        self, spec: GripperSpec, objects: ObjectWorld, dt: float, rule: str = STRICT, slides: float = RELATIVE_SPEED
    ) -> None:
        """Gripper of the profile; substeps of dt [s].

        ``rule``: one of `model.scene.GRASP_RULES`; ``slides`` [m/s]: speed beyond which the strict rule loses a cube.
        """
        self._strict, self._slides_from = rule == STRICT, slides
        self.spec = spec
        self.objects = objects
        self.dt = dt

    def start(self) -> GripperState:
        """State of an open, empty gripper."""
        return GripperState(width=self.spec.max_width)

    @staticmethod
    def moving(state: GripperState) -> bool:
        """True while the fingers move."""
        return state.phase in ("closing", "opening")

    def command(
        self, state: GripperState, command: str, now: float, tcp: Array, rotation: Array, cubes: Sequence[ObjectState]
    ) -> None:
        """React to a changed command at its time."""
        if command == "close" and state.phase in ("open", "opening"):
            self._begin(state, "closing", now)
            if state.held:
                return
            state.slid, state.outcome, state.candidate = False, "nothing", ""
            state.moment = state.along = 0.0
            if state.under:
                state.outcome = "no room"
                return
            between = math.inf
            for item in cubes:
                fits = state.width >= grasp.width_across(item.side, grasp.yaw_misfit(rotation, item))
                if item.state == "falling" or not fits or self._violation(tcp, rotation, item, state.width):
                    continue
                along = abs(dot(rotation[:, 0], item.position - tcp))
                if along < between:
                    between, state.candidate = along, item.name
        elif command == "open" and (
            state.phase in ("closing", "closed") or state.width != open_width(state, self.spec)
        ):
            state.candidate = ""
            self._begin(state, "opening", now)

    def step(
        self,
        state: GripperState,
        now: float,
        frames: Array,
        tcp_velocity: Array,
        cubes: Sequence[ObjectState],
        solids: Solids,
        *,
        stuck: bool = False,
    ) -> None:
        """One substep that ends at ``now`` [s] with the arm's ``frames`` (11, 4, 4); ``stuck`` fingers do not move."""
        hand = Hand(frames[TCP, :3, 3], frames[TCP, :3, :3], frames[HAND, :3, 3], tcp_velocity)
        by_name = {item.name: item for item in cubes} if state.held or self.moving(state) else {}
        if state.held:
            self._carry(state, hand, by_name[state.held])
        if stuck:
            state.began += self.dt
        elif state.phase == "closing":
            self._close(state, now, hand, by_name, solids)
        elif state.phase == "opening":
            self._open(state, now, hand, by_name)
        place = hand.tcp.tolist()
        for item in cubes:
            if not grasp.near(place, item.position) or item.name in (state.held, state.candidate):
                if state.under:
                    state.under = tuple(name for name in state.under if name != item.name)
                continue
            if item.state == "falling" or item.state.startswith("binned:"):
                continue
            self._touch(state, hand, item, cubes, solids)

    def _touch(
        self, state: GripperState, hand: Hand, item: ObjectState, cubes: Sequence[ObjectState], solids: Solids
    ) -> None:
        """Let a finger stand on a cube, or push it and the cubes behind it; nothing moves if furniture blocks them."""
        stood = item.name in state.under
        sunk = math.inf if stood else max(0.0, -float(hand.velocity[2]) * self.dt)
        if grasp.under(hand.rotation, hand.place, item, state.width, sunk=sunk):
            if not stood:
                state.under = (*state.under, item.name)
            return
        if stood:
            state.under = tuple(name for name in state.under if name != item.name)
        before = item.position
        if not grasp.push(hand.rotation, hand.place, item, state.width):
            return
        moved = grasp.make_room(item, cubes, solids)
        if moved is None:
            item.position = before
            state.under = (*state.under, item.name)
            return
        for one in moved:
            self.objects.check_support(one, cubes, solids)

    def _violation(self, tcp: Array, rotation: Array, item: ObjectState, width: float) -> str:
        if self._strict:
            return grasp.violation(tcp, rotation, item)
        return grasp.swept_violation(tcp, rotation, item, width)

    @staticmethod
    def lose(state: GripperState, name: str) -> None:
        """Let a person take this cube out of the fingers, which then close on nothing unless they are opening."""
        if name not in (state.held, state.candidate):
            return
        state.held = state.candidate = ""
        state.outcome = "taken"
        if state.phase == "closed":
            state.phase = "closing"

    @staticmethod
    def hold(state: GripperState, rotation: Array, hand: Array, item: ObjectState) -> None:
        """Move the held cube along with the hand."""
        item.position = hand + times(rotation, state.position_in_hand)
        item.rotation = product(rotation, state.rotation_in_hand)
        item.yaw = math.atan2(item.rotation[1, 0], item.rotation[0, 0])

    def _closing_duration(self, state: GripperState) -> float:
        """Time [s] from the command to a firm hold."""
        return self.spec.closing_time

    def _begin(self, state: GripperState, phase: str, now: float) -> None:
        state.phase, state.began, state.start_width = phase, now, state.width

    def _close(
        self, state: GripperState, now: float, hand: Hand, cubes: dict[str, ObjectState], solids: Solids
    ) -> None:
        if state.candidate:
            broken = self._violation(hand.tcp, hand.rotation, cubes[state.candidate], state.width)
            if broken:
                state.candidate, state.outcome = "", broken
            elif self._strict and norm(hand.velocity) > self._slides_from:
                state.slid = True
        name, usual = state.candidate or state.held, max(self.spec.closing_time, self.dt)
        if not name:
            state.width = max(0.0, state.width - self.spec.max_width / usual * self.dt)
            if state.width < 1e-9:
                state.width, state.phase = 0.0, "closed"
            return
        item = cubes[name]
        passed, lasts = now - state.began, self._closing_duration(state)
        done = passed >= lasts - EPSILON
        share = 1.0 if done else min(1.0, passed / usual)
        state.width = state.start_width + (item.side - state.start_width) * share
        if state.candidate:
            before, misfit = item.position, grasp.yaw_misfit(hand.rotation, item)
            if grasp.between_pads(hand.tcp, hand.rotation, item):
                self._centre(state, hand, item, list(cubes.values()), solids)
            if not state.candidate:
                return
            if not self._strict and passed < lasts - grasp.BOTH_TOUCH + EPSILON:  # a single pad turns it
                state.along = dot(hand.rotation[:, 0], item.position - hand.tcp)
                state.moment += grasp.moment_of_push(norm(item.position - before), state.along, misfit)
        if done and state.candidate and not self._strict and grasp.slips_out(state.along, state.moment):
            state.candidate, state.outcome = "", "offset"
            return
        if done:
            state.phase = "closed"
            if state.candidate:
                self._take(state, hand, item)

    def _centre(
        self, state: GripperState, hand: Hand, item: ObjectState, cubes: Sequence[ObjectState], solids: Solids
    ) -> None:
        """Centre the candidate between the pads, pushing its neighbours aside; without room it is not grasped."""
        position, yaw = item.position, item.yaw
        grasp.centre_between_pads(hand.tcp, hand.rotation, item, state.width)
        if item.position is position and item.yaw == yaw:
            return
        moved = grasp.make_room(item, cubes, solids)
        if moved is None:
            item.position = position
            item.turn_to(yaw)
            state.candidate, state.outcome = "", "no room"
            return
        for one in moved[1:]:
            self.objects.check_support(one, cubes, solids)

    @staticmethod
    def _take(state: GripperState, hand: Hand, item: ObjectState) -> None:
        state.held, state.candidate = item.name, ""
        state.held_from_z = float(item.position[2])
        state.outcome = "slipping" if state.slid else "held"
        state.position_in_hand = transposed_times(hand.rotation, item.position - hand.place)
        state.rotation_in_hand = product(hand.rotation.T, item.rotation)
        item.state = "held"

    def _open(self, state: GripperState, now: float, hand: Hand, cubes: dict[str, ObjectState]) -> None:
        wide = open_width(state, self.spec)
        share = min(1.0, (now - state.began) / max(self.spec.opening_time, self.dt))
        state.width = state.start_width + (wide - state.start_width) * share
        if share >= 1.0 - EPSILON:
            state.width, state.phase = wide, "open"
            if state.held:
                self._release(state, hand.velocity, cubes[state.held])

    def _carry(self, state: GripperState, hand: Hand, item: ObjectState) -> None:
        self.hold(state, hand.rotation, hand.place, item)
        slips = state.phase == "closed" and state.outcome == "slipping"
        if slips and item.position[2] > state.held_from_z + SLIP_HEIGHT:
            state.outcome = "dropped"
            self._release(state, hand.velocity, item)
            state.phase = "closing"

    @staticmethod
    def _release(state: GripperState, velocity: Array, item: ObjectState) -> None:
        """Release the cube into free flight, upright, with the gripper's velocity."""
        item.state = "falling"
        item.velocity = velocity.copy()
        item.turn_to(item.yaw)
        state.held = ""
