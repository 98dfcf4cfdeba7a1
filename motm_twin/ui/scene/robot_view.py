"""The robot, link by link, and the robots of a comparison.

The compared robots are tinted glass beside the real one. Dynamic bodies of either run are cylinders at their places in
that run, not in the twin. The compared robots are one batched node per link.

Ghosts are silhouettes of the base on its way, one whole robot at its next grasp or release, and a base at a clicked
place. Each silhouette is one convex hull of which only the front is drawn, so nothing shines through itself. The arm of
the whole robot reaches for the target from the chosen place of the base.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import trimesh
import viser
from viser.transforms import SO3

from motm_twin.bus.messages import TickMessage
from motm_twin.model.assets import LINKS, ghost_mesh, glb_bytes
from motm_twin.model.geometry import Array
from motm_twin.model.kinematics import Frankie
from motm_twin.model.profile import Q_MAX, Q_MIN, READY
from motm_twin.ui import colours
from motm_twin.ui.scene.drag import Spot
from motm_twin.ui.scene.light import LYING, NO_SHADOW, box_shadow_glb, round_shadow_glb
from motm_twin.ui.what_if import RUNS, Other

ROOT, OTHERS = "/robot", "/others"
AWAY = (0.0, 0.0, -100.0)  # [m] of the unused parts of a batch, out of sight
NO_LINES = np.zeros((1, 2, 3), dtype=np.float32)
COLOURED = np.zeros((1, 2, 3), dtype=np.uint8)  # for lines that will have several colours
MOST = 2  # robots of a comparison
MOST_MOVERS = 16  # dynamic bodies drawn per run
COLOUR_NAMES = ("orange", "green")  # of `colours.OTHERS`
_ROUND = 20  # corners of a cylinder
_WITHIN = 0.96  # scale of the second run's bodies: inside those of the first where they coincide
_LABEL_HEIGHT = 1.15  # [m]
_LABEL_STEP = 0.3  # [m] the second label is higher by this much
_SAME, _NEAR = 0.15, 1.1  # [m] below these, two robots are at one place; their labels would touch
Label = tuple[str, tuple[float, float, float]]  # text, place [m]


def add_batch(
    scene: viser.SceneApi, path: str, mesh: tuple[Any, Any], count: int, colour: Any, **options: Any
) -> viser.BatchedMeshHandle:
    """One node of ``count`` equal meshes (vertices, faces), all out of sight."""
    vertices, faces = mesh
    return scene.add_batched_meshes_simple(
        path, np.asarray(vertices, dtype=np.float32), np.asarray(faces, dtype=np.uint32), lod="off",
        batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), batched_positions=np.tile(AWAY, (count, 1)),
        batched_colors=colour, **NO_SHADOW, **options,
    )  # fmt: skip


def add_lines(
    scene: viser.SceneApi, path: str, colour: Any, thickness: float, points: Any = NO_LINES
) -> viser.LineSegmentsHandle:
    """Hidden line segments. A node created with one colour stays white when it is given several."""
    return scene.add_line_segments(path, points, colour, thickness=thickness, visible=False)


def put_batch(handles: Sequence[viser.BatchedMeshHandle], count: int, links: dict[int, Array]) -> None:
    """Place the links of each robot number at its transforms, shape (links, 4, 4); robots not in ``links`` vanish."""
    positions = np.tile(np.array(AWAY, dtype=np.float32), (len(handles), count, 1))
    turns = np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (len(handles), count, 1))
    for number, T in links.items():
        positions[:, number], turns[:, number] = T[:, :3, 3], SO3.from_matrix(T[:, :3, :3]).wxyz
    for handle, place, turn in zip(handles, positions, turns, strict=True):
        handle.batched_positions, handle.batched_wxyzs = place, turn


class RobotView:
    """One node per link."""

    def __init__(self, server: viser.ViserServer) -> None:
        scene = server.scene
        self.kinematics: Frankie | None = None  # None without an arm: only the base is drawn
        self._links = [
            scene.add_glb(f"{ROOT}/link/{link}", glb_bytes(link), visible=False, **NO_SHADOW) for link in LINKS
        ]
        self._shadows = [
            scene.add_glb(f"{ROOT}/shadow/{part}", dark, visible=False, **NO_SHADOW)
            for part, dark in (("base", box_shadow_glb(0.7, 0.5, 0.3)), ("arm", round_shadow_glb(0.15, 1.0)))
        ]
        self.on = True
        self.hand = np.eye(4)  # transform to the world, for the camera that rides with it

    def update(self, tick: TickMessage) -> None:
        """Move the links to the pose of the tick."""
        if self.kinematics is None:
            return
        robot = tick.robot
        T = self.kinematics.link_transforms(np.array(robot.true_pose), np.array(robot.q), robot.gripper_width)
        self.hand = T[LINKS.index("panda_hand")]
        quaternions = SO3.from_matrix(T[:, :3, :3]).wxyz
        for handle, wxyz, position in zip(self._links, quaternions, T[:, :3, 3], strict=True):
            handle.wxyz, handle.position = wxyz, position
        x, y, heading = robot.true_pose
        for shadow in self._shadows:
            shadow.position = (x, y, LYING)
        self._shadows[0].wxyz = SO3.from_z_radians(heading).wxyz
        for parts in (self._links, self._shadows):
            for number, handle in enumerate(parts):
                handle.visible = self.on and (self.kinematics.profile.has_arm or number == 0)


class ComparisonView:
    """The robots of a comparison: nodes made when the first one runs, and a label per robot."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._scene = server.scene
        self.kinematics: Frankie | None = None
        self._links: list[viser.BatchedMeshHandle] = []
        self._movers: viser.BatchedMeshHandle | None = None
        self._labels: list[viser.LabelHandle] = []
        self._shown = False

    def update(self, others: Sequence[Other]) -> None:
        """Draw these robots, at most `MOST`."""
        robots = others[:MOST]
        if self.kinematics is None or not (robots or self._shown):
            return
        if not self._links:
            self._make()
        transforms = self.kinematics.link_transforms
        links = [transforms(np.array(robot.pose), np.array(robot.q), robot.gripper) for robot in robots]
        put_batch(self._links, MOST, dict(enumerate(links)))
        self._move(robots)
        found = labels(robots)
        for i, label in enumerate(self._labels):
            label.visible = i < len(found)
            if i < len(found):
                label.text, label.position = found[i]
        self._shown = bool(robots)

    def _make(self) -> None:
        tints = np.array(colours.OTHERS[:MOST], dtype=np.uint8)
        self._links = [
            add_batch(self._scene, f"{OTHERS}/{link}", ghost_mesh(link), MOST, tints, opacity=0.5) for link in LINKS
        ]
        shape = trimesh.creation.cylinder(1.0, segment=((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), sections=_ROUND)
        count = MOST * MOST_MOVERS
        self._movers = add_batch(
            self._scene, f"{OTHERS}/movers", (shape.vertices, shape.faces), count, np.repeat(tints, MOST_MOVERS, 0),
            batched_scales=np.full((count, 3), 0.1, dtype=np.float32), opacity=0.3,
        )  # fmt: skip
        look = {"font_screen_scale": 0.7, "anchor": "bottom-center", "visible": False}
        self._labels = [self._scene.add_label(f"{OTHERS}/label{i}", "", **look) for i in range(MOST)]

    def _move(self, robots: Sequence[Other]) -> None:
        assert self._movers is not None
        places = np.tile(np.array(AWAY, dtype=np.float32), (MOST * MOST_MOVERS, 1))
        sizes = np.full_like(places, 0.1)  # radius, radius, height [m]
        for i, robot in enumerate(robots):
            for k, (x, y, radius, height) in enumerate(robot.movers[:MOST_MOVERS], i * MOST_MOVERS):
                places[k], sizes[k] = (x, y, 0.0), _WITHIN**i * np.array((radius, radius, height))
        self._movers.batched_scales, self._movers.batched_positions = sizes, places


def labels(robots: Sequence[Other]) -> list[Label]:
    """Texts above these robots and their places: two that are near each other share one."""
    if len(robots) == MOST:
        a, b = robots
        apart = math.dist(a.pose[:2], b.pose[:2])
        middle = (0.5 * (a.pose[0] + b.pose[0]), 0.5 * (a.pose[1] + b.pose[1]), _LABEL_HEIGHT)
        later = a.label.removeprefix(RUNS[0])
        if apart < _SAME and (a.label, b.label) == (RUNS[0] + later, RUNS[1] + later):
            return [(f"both runs{later}", middle)]
        if apart < _NEAR:
            names = (f"{robot.label} ({name})" for robot, name in zip(robots, COLOUR_NAMES, strict=True))
            return [("  |  ".join(names), middle)]
    return [
        (robot.label, (robot.pose[0], robot.pose[1], _LABEL_HEIGHT + i * _LABEL_STEP)) for i, robot in enumerate(robots)
    ]


SILHOUETTES = 3
FREE = 0.8  # [m] round the robot without silhouettes, so that it stays visible
APART = 0.55  # [m] between two silhouettes
FADES_IN = (0.10, 0.18, 0.26)  # opacity, the nearest first
ARRIVAL_OPACITY = 0.34
PROPOSED_OPACITY = 0.45
ARRIVAL_LINKS = LINKS[:-2]  # without the fingers, which are too small to matter
OVER_BIN = 0.22  # [m] height of the tool over the floor of a bin
_STEPS, _DAMPING, _MOST = 80, 0.05, 0.2  # iterations; damping [m]; largest step [rad]
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
        self._known, self._q = (), READY  # last computed arrival, and its joints [rad]
        self.on = True

    def propose(self, going: tuple[float, float] | None, tick: TickMessage) -> None:
        """Show a base at the proposed place [m] of a drive, heading as if driven straight there; None hides it."""
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
            if key != self._known:  # else the joints are still valid
                self._known, self._q = key, reaching(self.kinematics, arrival, point)
            whole[0] = self.kinematics.link_transforms(arrival, self._q)[: len(ARRIVAL_LINKS)]
        put_batch(self._arrival, 1, whole)


@cache
def hull_mesh(link: str) -> tuple[Array, Array]:
    """Convex hull of a link's light mesh: vertices (n, 3) [m] and faces (m, 3)."""
    hull = trimesh.convex.convex_hull(trimesh.Trimesh(*ghost_mesh(link)))
    return np.asarray(hull.vertices), np.asarray(hull.faces)


def arrival_pose(tick: TickMessage) -> Array | None:
    """Chosen place of the base, shape (3,); None without one, or when the robot is already there."""
    placement = tick.placement
    goal = np.array([0.0 if value is None else value for value in placement.goal])
    here = np.array(tick.robot.true_pose)
    if placement.mode == "none" or not placement.goal_has_heading or np.hypot(*(goal[:2] - here[:2])) < FREE:
        return None
    return goal


def silhouette_poses(plan: Array, arrival: Array | None) -> Array:
    """Up to `SILHOUETTES` poses of the plan (n, 3), shape (j, 3), apart from robot, arrival and each other."""
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
    """Joints (7,) [rad] with the tool at a world point (3,) [m] and pointing down; damped least squares."""
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
