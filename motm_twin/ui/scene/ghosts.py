"""Ghosts: silhouettes of the base on its way, one whole robot at its next grasp or release, a base where a click was.

Each silhouette is one convex hull of which only the front is drawn, so nothing shines through itself. The arm of the
whole robot reaches for the target from the chosen place of the base.
"""

from functools import cache
from typing import Any

import numpy as np
import trimesh
import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.model.assets import ghost_mesh
from motm_twin.model.geometry import Array
from motm_twin.model.joint_limits import Q_MAX, Q_MIN, READY
from motm_twin.model.kinematics import LINKS, Frankie
from motm_twin.ui import colours
from motm_twin.ui.scene.drag import Spot
from motm_twin.ui.scene.robot_view import ROOT, add_batch, put_batch

SILHOUETTES = 3
FREE = 0.8  # [m] round the robot without any: the robot itself is to be seen
APART = 0.55  # [m] between two
FADES_IN = (0.10, 0.18, 0.26)  # opacity, the nearest first
ARRIVAL_OPACITY = 0.34
PROPOSED_OPACITY = 0.45
ARRIVAL_LINKS = LINKS[:-2]  # fingers are too small to matter there
OVER_BIN = 0.22  # [m] of the tool over the floor of a bin
_STEPS, _DAMPING, _MOST = 80, 0.05, 0.2  # iterations; [m]; [rad] of one
_DOWN = np.array([0.0, 0.0, -1.0])


class GhostView:
    """Silhouettes of the base, and the robot at its next grasp or release."""

    def __init__(self, server: viser.ViserServer) -> None:

        def add(path: str, link: str, count: int, colour: colours.Rgb, opacity: float, **more: Any) -> Any:
            path = f"{ROOT}/{path}"
            return add_batch(server.scene, path, hull_mesh(link), count, colour, opacity=opacity, side="front", **more)

        fades, base = np.array(FADES_IN, dtype=np.float32), LINKS[0]
        self._silhouettes = add("silhouette", base, SILHOUETTES, colours.PLAN, 0.99, batched_opacities=fades)
        self._arrival = [add(f"arrival/{link}", link, 1, colours.PLAN, ARRIVAL_OPACITY) for link in ARRIVAL_LINKS]
        self._proposed = add("proposed", base, 1, colours.TARGET, PROPOSED_OPACITY, visible=False)
        self._going: tuple[float, float] | None = None
        self.kinematics: Frankie | None = None
        self._known, self._q = (), READY  # arrival that was computed last, and its joints
        self.on = True

    def propose(self, going: tuple[float, float] | None, tick: TickMessage) -> None:
        """A base at the place [m] where a drive is proposed, heading as it would come straight there; None hides it."""
        if going == self._going or self.kinematics is None:
            return
        self._going, self._proposed.visible = going, going is not None
        if going is not None:
            way = np.subtract(going, tick.robot.true_pose[:2])
            pose = np.array([*going, np.arctan2(way[1], way[0])])
            put_batch([self._proposed], 1, {0: self.kinematics.link_transforms(pose, READY)[:1]})

    def update(self, tick: TickMessage, spot: Spot | None) -> None:
        """Set the ghosts along the plan of the tick; ``spot``: believed place of the target."""
        if self.kinematics is None:
            return
        arrival = arrival_pose(tick) if self.on and spot is not None else None
        plan = np.array(tick.plan.local_poses).reshape(-1, 5)[:, :3]
        poses = silhouette_poses(plan, arrival) if self.on else plan[:0]
        bases = {
            number: self.kinematics.link_transforms(pose, READY)[:1]
            for number, pose in enumerate(poses, SILHOUETTES - len(poses))
        }
        put_batch([self._silhouettes], SILHOUETTES, bases)
        whole = {}
        if arrival is not None and spot is not None and self.kinematics.profile.has_arm:
            place = tick.tasks[tick.task_index].kind == "place"
            point = np.array([spot.x, spot.y, spot.z + (OVER_BIN if place else 0.5 * spot.height)])
            key = tuple(np.round([*arrival, *point], 2).tolist())
            if key != self._known:  # else the arm reaches as before
                self._known, self._q = key, reaching(self.kinematics, arrival, point)
            whole[0] = self.kinematics.link_transforms(arrival, self._q)[: len(ARRIVAL_LINKS)]
        put_batch(self._arrival, 1, whole)


@cache
def hull_mesh(link: str) -> tuple[Array, Array]:
    """Convex hull of a link's light mesh: vertices (n, 3) [m] and faces (m, 3)."""
    hull = trimesh.convex.convex_hull(trimesh.Trimesh(*ghost_mesh(link)))
    return np.asarray(hull.vertices), np.asarray(hull.faces)


def arrival_pose(tick: TickMessage) -> Array | None:
    """Chosen place of the base, shape (3,); None when there is none, or the robot is there already."""
    placement = tick.placement
    goal = np.array([0.0 if value is None else value for value in placement.goal])
    here = np.array(tick.robot.true_pose)
    if placement.mode == "none" or not placement.goal_has_heading or np.hypot(*(goal[:2] - here[:2])) < FREE:
        return None
    return goal


def silhouette_poses(plan: Array, arrival: Array | None) -> Array:
    """Up to `SILHOUETTES` poses of the plan (n, 3), shape (j, 3): off the robot, off the arrival and off each other."""
    chosen: list[Array] = []
    for pose in plan:
        taken = [*chosen, *(() if arrival is None else (arrival,))]
        far = np.hypot(*(pose[:2] - plan[0, :2])) >= FREE
        if far and all(np.hypot(*(pose[:2] - other[:2])) >= APART for other in taken):
            chosen.append(pose)
    if len(chosen) > SILHOUETTES:
        chosen = [chosen[i] for i in np.linspace(0, len(chosen) - 1, SILHOUETTES).round().astype(int)]
    return np.array(chosen).reshape(-1, 3)


def reaching(kinematics: Frankie, base: Array, point: Array) -> Array:
    """Joints (7,) [rad] with the tool at a world point (3,) [m] and pointing down, as near as damped steps come."""
    q = READY.copy()
    side = np.array([point[0] - base[0], point[1] - base[1]])
    q[0] = np.clip(np.arctan2(side[1], side[0]) - base[2], Q_MIN[0], Q_MAX[0])
    for _ in range(_STEPS):
        position, rotation = kinematics.tcp_pose(base, q)
        tilt = np.cross(rotation[:, 2], _DOWN)
        error = np.concatenate([point - position, 0.3 * tilt])
        J = kinematics.tcp_jacobian(base, q)[:, 2:]
        J[3:] *= 0.3
        step = J.T @ np.linalg.solve(J @ J.T + _DAMPING**2 * np.eye(6), error)
        q = np.clip(q + np.clip(step, -_MOST, _MOST), Q_MIN, Q_MAX)
    return q
