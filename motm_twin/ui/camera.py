"""Camera: presets, and following the robot; moves are eased, never cut."""

import math
import threading
import time
from dataclasses import dataclass

import numpy as np
import viser

from motm_twin.model.geometry import Array
from motm_twin.model.scene import Scene

PRESETS = ("Overview", "Top", "Follow")
EASE = 0.6  # [s] of a move from one preset to another
FIELD_OF_VIEW = math.radians(45.0)
_CHASE = (2.7, 2.1)  # [m] behind and above the robot
_CHASE_RATE = 1.6  # [1/s] how fast a following camera swings round


@dataclass
class _Move:
    start: float
    position: tuple[Array, Array]
    look_at: tuple[Array, Array]


class Cameras:
    """The camera of every visitor."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._lock = threading.Lock()
        self._moves: dict[int, _Move] = {}
        self._following: dict[int, Array] = {}
        self._views: dict[str, tuple[Array, Array]] = {}
        self._robot = np.zeros(3)
        server.initial_camera.fov = FIELD_OF_VIEW
        server.on_client_disconnect(lambda client: self._forget(client.client_id))

    def show(self, scene: Scene) -> None:
        """Choose views that hold a scene, and start new visitors in the overview."""
        with self._lock:
            self._views = {"Overview": overview(scene), "Top": from_above(scene)}
        self._server.initial_camera.position, self._server.initial_camera.look_at = overview(scene)

    def choose(self, client: viser.ClientHandle, preset: str) -> None:
        """Move one visitor's camera to a preset, or let it follow the robot."""
        with self._lock:
            self._following.pop(client.client_id, None)
            if preset == "Follow":
                position, look_at = _chase(self._robot)
                self._following[client.client_id] = np.array([self._robot[2]])
            elif preset in self._views:
                position, look_at = self._views[preset]
            else:
                return
            self._moves[client.client_id] = _Move(
                time.monotonic(),
                (np.array(client.camera.position), position),
                (np.array(client.camera.look_at), look_at),
            )

    def update(self, pose: Array, dt: float) -> None:
        """Advance running moves and followers; ``pose`` is the robot's, ``dt`` [s] since the last call."""
        with self._lock:
            self._robot = pose
            if not self._moves and not self._following:
                return
            clients = self._server.get_clients()
            wanted = {
                number: view for number in clients if (view := self._view(number, time.monotonic(), dt)) is not None
            }
        for number, (position, look_at) in wanted.items():
            client = clients[number]
            with client.atomic():
                client.camera.position = position
                client.camera.look_at = look_at

    def _view(self, number: int, now: float, dt: float) -> tuple[Array, Array] | None:
        follow = self._following.get(number)
        target = None
        if follow is not None:
            turn = math.remainder(self._robot[2] - follow[0], 2 * math.pi)
            follow[0] += turn * min(1.0, _CHASE_RATE * dt)
            target = _chase(np.array([self._robot[0], self._robot[1], follow[0]]))
        move = self._moves.get(number)
        if move is None:
            return target
        part = min(1.0, (now - move.start) / EASE)
        if part >= 1.0:
            del self._moves[number]
        part = part * part * (3.0 - 2.0 * part)
        end = target or (move.position[1], move.look_at[1])
        return (
            move.position[0] + (end[0] - move.position[0]) * part,
            move.look_at[0] + (end[1] - move.look_at[0]) * part,
        )

    def _forget(self, number: int) -> None:
        with self._lock:
            self._moves.pop(number, None)
            self._following.pop(number, None)


def overview(scene: Scene) -> tuple[Array, Array]:
    """Position and look-at point [m] that show the whole of a scene from its front left."""
    centre, reach = interest(scene)
    look_at = np.array([centre[0], centre[1], 0.25])
    return look_at + np.array([-0.36, -0.74, 0.57]) * reach * 2.45, look_at


def from_above(scene: Scene) -> tuple[Array, Array]:
    """Position and look-at point [m] for a plan view, x to the right."""
    centre, reach = interest(scene)
    return np.array([centre[0], centre[1] - 0.02, reach * 3.1]), np.array([centre[0], centre[1], 0.0])


def interest(scene: Scene) -> tuple[tuple[float, float], float]:
    """Centre [m] and half size [m] of what happens in a scene: start, cubes, bins, waypoints."""
    points = [scene.start[:2], *(item.position[:2] for item in scene.objects), *(box.centre for box in scene.bins)]
    for agent in scene.agents:
        points += [agent.start[:2], *agent.waypoints]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    centre = (low + high) / 2
    return (float(centre[0]), float(centre[1])), float(max(1.6, 0.5 * np.linalg.norm(high - low)))


def _chase(pose: Array) -> tuple[Array, Array]:
    ahead = np.array([math.cos(pose[2]), math.sin(pose[2]), 0.0])
    base = np.array([pose[0], pose[1], 0.0])
    return base - _CHASE[0] * ahead + [0.0, 0.0, _CHASE[1]], base + 0.5 * ahead + [0.0, 0.0, 0.45]
