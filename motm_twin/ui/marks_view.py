"""Small marks on the task: where the active target is believed, points to drive to, and beliefs that are off."""

import dataclasses

import numpy as np
import trimesh
import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.ui import colours
from motm_twin.ui.aim import Surroundings
from motm_twin.ui.selection_view import Spot, ring, spot_of

ROOT = "/marks"
OFF = 0.01  # [m] a belief must be wrong by this much to be shown
BELIEFS = 16
MARKS = 8
_AWAY = -100.0  # [m] where unused marks wait


class MarksView:
    """Three nodes, however many marks there are."""

    def __init__(self, server: viser.ViserServer) -> None:
        add = server.scene
        self._target = add.add_line_segments(
            f"{ROOT}/target", ring(0.06), colours.TARGET, thickness=0.010, visible=False
        )
        flag = _flag()
        waiting = np.full((MARKS, 3), (0.0, 0.0, _AWAY), dtype=np.float32)
        self._drives = add.add_batched_meshes_simple(
            f"{ROOT}/drive_to", np.asarray(flag.vertices, dtype=np.float32), np.asarray(flag.faces, dtype=np.uint32),
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (MARKS, 1)), batched_positions=waiting,
            batched_colors=colours.DRIVE_TO, lod="off", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        cube = trimesh.creation.box((1.0, 1.0, 1.0))
        self._beliefs = add.add_batched_meshes_simple(
            f"{ROOT}/beliefs", np.asarray(cube.vertices, dtype=np.float32), np.asarray(cube.faces, dtype=np.uint32),
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (BELIEFS, 1)),
            batched_positions=np.full((BELIEFS, 3), (0.0, 0.0, _AWAY), dtype=np.float32),
            batched_scales=np.full(BELIEFS, 0.04), batched_colors=colours.BELIEF, opacity=0.45, lod="off",
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        self._shown: dict[str, object] = {}

    def update(self, tick: TickMessage, surroundings: Surroundings) -> None:
        """Mark what this tick is about."""
        self._show_target(tick, surroundings)
        self._put(self._drives, "drives", np.array([(*point, 0.0) for point in drive_points(tick)[:MARKS]]), MARKS)
        self._put(self._beliefs, "beliefs", believed(tick)[:BELIEFS], BELIEFS)

    def _show_target(self, tick: TickMessage, surroundings: Surroundings) -> None:
        spot = target_spot(tick, surroundings)
        key = (
            None
            if spot is None
            else (round(spot.x, 3), round(spot.y, 3), round(spot.z, 3), round(0.7 * spot.radius, 3))
        )
        if key == self._shown.get("target"):
            return
        before, self._shown["target"] = self._shown.get("target"), key
        self._target.visible = key is not None
        if key is not None:
            self._target.position = (key[0], key[1], key[2] + 0.008)
            if not isinstance(before, tuple) or before[3] != key[3]:
                self._target.points = ring(key[3])

    def _put(self, handle: viser.BatchedMeshHandle, name: str, places: np.ndarray, count: int) -> None:
        positions = np.full((count, 3), (0.0, 0.0, _AWAY), dtype=np.float32)
        if len(places):
            positions[: len(places)] = places
        key = positions.tobytes()
        if self._shown.get(name) != key:
            self._shown[name] = key
            handle.batched_positions = positions


def target_spot(tick: TickMessage, surroundings: Surroundings) -> Spot | None:
    """Where the robot believes what it picks or places at; None when it does neither."""
    task = tick.tasks[tick.task_index] if tick.task_index < len(tick.tasks) else None
    spot = None if task is None or task.kind == "drive_to" else spot_of(task.target, tick, surroundings)
    if spot is None or task is None:
        return None
    true = next((item.position for item in tick.objects if item.name == task.target), None)
    belief = next((belief.position for belief in tick.beliefs if belief.name == task.target), None)
    if true is None or belief is None:
        return spot
    x, y, z = belief
    return dataclasses.replace(spot, x=x, y=y, z=spot.z + z - true[2])


def drive_points(tick: TickMessage) -> list[tuple[float, float]]:
    """Points [m] that the robot is still to drive to."""
    points = []
    for task in tick.tasks[tick.task_index :]:
        if task.kind == "drive_to" and task.status not in ("done", "failed", "skipped"):
            x, y = task.target.strip("()").split(",")
            points.append((float(x), float(y)))
    return points


def believed(tick: TickMessage) -> np.ndarray:
    """Where the robot believes cubes to be that are elsewhere, shape (n, 3) [m]."""
    true = {item.name: np.asarray(item.position) for item in tick.objects}
    return np.array(
        [
            belief.position
            for belief in tick.beliefs
            if belief.name in true and np.linalg.norm(np.asarray(belief.position) - true[belief.name]) > OFF
        ]
    ).reshape(-1, 3)


def _flag() -> trimesh.Trimesh:
    """A pin that stands on its point, with a disc on the floor."""
    cone = trimesh.creation.cone(radius=0.05, height=0.14, sections=20)
    cone.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0]))
    cone.apply_translation((0.0, 0.0, 0.16))
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.055)
    ball.apply_translation((0.0, 0.0, 0.18))
    disc = trimesh.creation.annulus(r_min=0.12, r_max=0.15, height=0.006, sections=32)
    disc.apply_translation((0.0, 0.0, 0.02))
    joined = trimesh.util.concatenate([cone, ball, disc])
    assert isinstance(joined, trimesh.Trimesh)
    return joined
