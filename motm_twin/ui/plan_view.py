"""What the base intends: candidates by cost, the way to the chosen one and on to the next target, the local plan."""

import itertools

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from motm_twin.bus.messages import PlacementMessage, TickMessage
from motm_twin.ui import colours
from motm_twin.ui.rotation import yaw_wxyz, yaws_wxyz

ROOT = "/plan"
CAPACITY = 72
HEIGHT = 0.035  # [m]
DASH = 0.08  # [m]
APART = 0.028  # [m] a candidate is shifted along its heading, so that both headings of a place can be seen


class PathLine:
    """A polyline just above the floor."""

    def __init__(
        self, server: viser.ViserServer, name: str, colour: colours.Rgb, height: float, width: float,
        *, dashed: bool = False,
    ) -> None:  # fmt: skip
        self._height = height
        self._handle = server.scene.add_line_segments(
            f"{ROOT}/{name}", np.zeros((1, 2, 3), dtype=np.float32), colour, thickness=width, visible=False
        )

        self._dashed = dashed
        self._points: list[list[float]] = []

    def update(self, points: list[list[float]], on: bool) -> None:
        """Draw through these points; nothing when there are fewer than two."""
        visible = on and len(points) > 1
        if self._handle.visible != visible:
            self._handle.visible = visible
        if visible and points != self._points:
            self._points = points
            flat = np.asarray(points, dtype=np.float32)
            pieces = dashes(flat) if self._dashed else np.stack([flat[:-1], flat[1:]], axis=1)
            heights = np.full((*pieces.shape[:2], 1), self._height, dtype=np.float32)
            self._handle.points = np.concatenate([pieces, heights], axis=2)


class CandidateView:
    """All candidates as one batched mesh: a ball with a nose that points along the heading."""

    def __init__(self, server: viser.ViserServer) -> None:
        mesh = _pointed_ball()
        waiting = np.zeros((CAPACITY, 3))
        self._handle = server.scene.add_batched_meshes_simple(
            f"{ROOT}/candidates",
            np.asarray(mesh.vertices, dtype=np.float32),
            np.asarray(mesh.faces, dtype=np.uint32),
            batched_wxyzs=yaws_wxyz(np.zeros(CAPACITY)),
            batched_positions=waiting,
            batched_scales=np.full(CAPACITY, 1e-3),
            batched_colors=np.full((CAPACITY, 3), 128, dtype=np.uint8),
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )
        self._goal = server.scene.add_line_segments(
            f"{ROOT}/goal", _goal_mark(), colours.GOAL, thickness=0.022, visible=False
        )
        self._key: tuple = ()

    def update(self, placement: PlacementMessage, on: bool, picked: int | None) -> None:
        """Place and colour the candidates; the chosen and the picked one are larger."""
        key = (placement, on, picked)
        if key == self._key:
            return
        self._key = key
        count = min(len(placement.poses), CAPACITY) if on else 0
        positions, scales = np.zeros((CAPACITY, 3)), np.full(CAPACITY, 1e-3)
        yaws, tones = np.zeros(CAPACITY), np.tile(np.array(colours.REJECTED, dtype=np.uint8), (CAPACITY, 1))
        if count:
            poses = np.array(placement.poses)[:count]
            yaws[:count] = poses[:, 2]
            positions[:count, 0] = poses[:, 0] + APART * np.cos(poses[:, 2])
            positions[:count, 1] = poses[:, 1] + APART * np.sin(poses[:, 2])
            positions[:count, 2] = HEIGHT
            viable = np.array([not reason for reason in placement.rejected[:count]])
            scales[:count] = np.where(viable, 1.0, 0.5)
            tones[:count][viable] = colours.scale(relative_cost(placement)[:count][viable])
            for index, factor in ((placement.chosen, 1.8), (picked, 1.5)):
                if index is not None and 0 <= index < count:
                    scales[index] *= factor
        handle = self._handle
        handle.batched_positions = positions.astype(np.float32)
        handle.batched_wxyzs = yaws_wxyz(yaws).astype(np.float32)
        handle.batched_scales, handle.batched_colors = scales, tones
        self._show_goal(placement, on)

    def _show_goal(self, placement: PlacementMessage, on: bool) -> None:
        visible = on and placement.mode != "none"
        if self._goal.visible != visible:
            self._goal.visible = visible
        if visible:
            x, y, heading = (value or 0.0 for value in placement.goal)
            self._goal.position, self._goal.wxyz = (x, y, 0.02), yaw_wxyz(heading)


class PlanView:
    """Paths and candidates of a tick."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._paths = PathLine(server, "global_path", colours.GLOBAL_PATH, 0.022, 0.032)
        self._next = PathLine(server, "next_path", colours.NEXT_PATH, 0.018, 0.028)
        self._bezier = PathLine(server, "bezier", colours.BEZIER, 0.026, 0.02)
        self._local = PathLine(server, "local_plan", colours.BRAND, 0.030, 0.02)
        self._staa = PathLine(server, "staa_path", colours.STAA_PATH, 0.016, 0.030)
        self._inspected = PathLine(server, "inspected", colours.INSPECTED, 0.034, 0.026)
        self._inspected_next = PathLine(server, "inspected_next", colours.INSPECTED_NEXT, 0.034, 0.026, dashed=True)
        self.candidates = CandidateView(server)
        self.candidates_on = self.paths_on = True
        self.staa_on = False
        self.picked: int | None = None

    def update(self, tick: TickMessage) -> None:
        """Draw the plan of a tick."""
        plan = tick.plan
        self._paths.update(plan.global_path, self.paths_on)
        self._next.update(plan.next_path, self.paths_on)
        self._bezier.update(plan.bezier, self.paths_on)
        self._local.update([pose[:2] for pose in plan.local_poses], self.paths_on)
        self._staa.update(plan.staa_path, self.staa_on)
        inspected = tick.inspected if tick.inspected is not None and tick.inspected.candidate == self.picked else None
        self._inspected.update(inspected.path if inspected else [], inspected is not None)
        self._inspected_next.update(inspected.next_path if inspected else [], inspected is not None)
        self.candidates.update(tick.placement, self.candidates_on, self.picked)


def dashes(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """A polyline (n, 2) as dashes of `DASH` with gaps as long, shape (m, 2, 2)."""
    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(gaps)])
    ends = np.minimum(np.arange(0.0, max(float(length[-1]), DASH), DASH), length[-1])
    if len(ends) % 2:
        ends = np.append(ends, length[-1])
    marks = np.stack([np.interp(ends, length, points[:, i]) for i in (0, 1)], axis=1)
    return marks.reshape(-1, 2, 2).astype(np.float32)


def relative_cost(placement: PlacementMessage) -> NDArray[np.float64]:
    """Costs mapped to 0 (cheapest) .. 1 (dearest); rejected candidates are nan. Shape (n,)."""
    cost = np.array([np.nan if value is None else value for value in placement.cost], dtype=float)
    known = cost[np.isfinite(cost)]
    if known.size == 0:
        return cost
    return (cost - known.min()) / max(float(known.max() - known.min()), 1e-6)


def _pointed_ball() -> trimesh.Trimesh:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.028)
    nose = trimesh.creation.cone(radius=0.02, height=0.058, sections=12)
    nose.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    nose.apply_translation((0.012, 0.0, 0.0))
    return trimesh.Trimesh(
        np.concatenate([ball.vertices, nose.vertices]),
        np.concatenate([ball.faces, nose.faces + len(ball.vertices)]),
        process=False,
    )


def _goal_mark() -> NDArray[np.float32]:
    """The outline of the base with an arrow, at the origin; shape (n, 2, 3)."""
    outline = [(-0.35, -0.25), (0.35, -0.25), (0.35, 0.25), (-0.35, 0.25), (-0.35, -0.25)]
    arrow = [((0.0, 0.0), (0.28, 0.0)), ((0.28, 0.0), (0.18, 0.08)), ((0.28, 0.0), (0.18, -0.08))]
    pieces = [*itertools.pairwise(outline), *arrow]
    return np.array([[(*start, 0.0), (*end, 0.0)] for start, end in pieces], dtype=np.float32)
