"""Robots of a comparison: the same session under other parameters, drawn as tinted glass beside the real one.

So is who moves about in either run, as cylinders: they go where each run finds them, not where they are now.
"""

import math
from collections.abc import Sequence

import numpy as np
import trimesh
import viser

from motm_twin.model.assets import ghost_mesh
from motm_twin.model.geometry import Array
from motm_twin.model.kinematics import LINKS, Frankie
from motm_twin.model.profile import RobotProfile
from motm_twin.ui import colours
from motm_twin.ui.rotation import matrices_wxyz
from motm_twin.ui.what_if import RUNS, Other

ROOT = "/others"
MOST = 2
MOST_MOVERS = 16  # of each run that are drawn
_ROUND = 20  # corners of a cylinder
_WITHIN = 0.96  # where both runs have one at the same place, that of the second is within that of the first
_AWAY = -100.0  # [m]
_LABEL_HEIGHT = 1.15  # [m]
_LABEL_STEP = 0.3  # [m] that the second label stands higher
_SAME, _NEAR = 0.15, 1.1  # [m] between two robots that stand at one place, and whose labels would touch
COLOUR_NAMES = ("orange", "violet")  # of `colours.OTHERS`
Label = tuple[str, tuple[float, float, float]]  # text, place [m]


def labels(robots: Sequence[Other]) -> list[Label]:
    """What is written where above these robots: one label for two that are near each other, so that none touch."""
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


class OtherView:
    """One batched node per link, made when the first comparison runs, and a label per robot."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._kinematics: Frankie | None = None
        self._links: list[viser.BatchedMeshHandle] = []
        self._movers: viser.BatchedMeshHandle | None = None
        self._labels: list[viser.LabelHandle] = []
        self._shown = False

    def configure(self, profile: RobotProfile) -> None:
        """Another robot profile."""
        self._kinematics = Frankie(profile)

    def update(self, others: Sequence[Other]) -> None:
        """Draw these, at most `MOST`."""
        robots = others[:MOST]
        if self._kinematics is None or not (robots or self._shown):
            return
        if not self._links:
            self._links = [self._add_link(link) for link in LINKS]
            self._movers = self._add_movers()
            self._labels = [
                self._server.scene.add_label(
                    f"{ROOT}/label{i}", "", font_screen_scale=0.7, anchor="bottom-center", visible=False
                )
                for i in range(MOST)
            ]
        positions = np.full((len(LINKS), MOST, 3), (0.0, 0.0, _AWAY), dtype=np.float32)
        turns = np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (len(LINKS), MOST, 1))
        for i, robot in enumerate(robots):
            T = self._kinematics.link_transforms(np.array(robot.pose), np.array(robot.q), robot.gripper)
            positions[:, i], turns[:, i] = T[:, :3, 3], matrices_wxyz(T[:, :3, :3])
        for handle, place, turn in zip(self._links, positions, turns, strict=True):
            handle.batched_positions, handle.batched_wxyzs = place, turn
        self._move(robots)
        self._write(labels(robots))
        self._shown = bool(robots)

    def _move(self, robots: Sequence[Other]) -> None:
        assert self._movers is not None
        places, sizes = _nobody()
        for i, robot in enumerate(robots):
            for k, (x, y, radius, height) in enumerate(robot.movers[:MOST_MOVERS]):
                size = _WITHIN**i * np.array((radius, radius, height))
                places[i * MOST_MOVERS + k], sizes[i * MOST_MOVERS + k] = (x, y, 0.0), size
        self._movers.batched_scales = sizes
        self._movers.batched_positions = places

    def _write(self, found: Sequence[Label]) -> None:
        for i, label in enumerate(self._labels):
            if i < len(found):
                text, label.position = found[i]
                if label.text != text:
                    label.text = text
            if label.visible != (i < len(found)):
                label.visible = i < len(found)

    def _add_link(self, link: str) -> viser.BatchedMeshHandle:
        vertices, faces = ghost_mesh(link)
        return self._server.scene.add_batched_meshes_simple(
            f"{ROOT}/{link}", np.asarray(vertices, dtype=np.float32), faces,
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (MOST, 1)),
            batched_positions=np.full((MOST, 3), (0.0, 0.0, _AWAY), dtype=np.float32),
            batched_colors=np.array(colours.OTHERS[:MOST], dtype=np.uint8), opacity=0.5, lod="off",
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def _add_movers(self) -> viser.BatchedMeshHandle:
        shape = trimesh.creation.cylinder(1.0, segment=((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), sections=_ROUND)
        places, sizes = _nobody()
        return self._server.scene.add_batched_meshes_simple(
            f"{ROOT}/movers", np.asarray(shape.vertices, dtype=np.float32), np.asarray(shape.faces),
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (len(places), 1)), batched_positions=places,
            batched_scales=sizes, batched_colors=np.repeat(np.array(colours.OTHERS, dtype=np.uint8), MOST_MOVERS, 0),
            opacity=0.3, lod="off", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip


def _nobody() -> tuple[Array, Array]:
    """Positions [m] and sizes (radius, radius, height) [m] of movers that are not there, both (2 x 16, 3)."""
    count = MOST * MOST_MOVERS
    return np.full((count, 3), (0.0, 0.0, _AWAY), dtype=np.float32), np.full((count, 3), 0.1, dtype=np.float32)
