"""The robot, link by link, and its plan as ghosts that fade into the future."""

import numpy as np
import viser
from numpy.typing import NDArray

from motm_twin.bus.messages import TickMessage
from motm_twin.model.assets import ghost_mesh, glb_bytes
from motm_twin.model.kinematics import LINKS, Frankie
from motm_twin.model.profile import RobotProfile
from motm_twin.ui import colours
from motm_twin.ui.body_view import LYING
from motm_twin.ui.rotation import matrices_wxyz, yaw_wxyz
from motm_twin.ui.shadows import box_shadow_glb, round_shadow_glb

ROOT = "/robot"
GHOSTS = 7
GHOST_GAP = 0.22  # [m] between two ghosts
GHOST_LINKS = LINKS[:-2]  # fingers are too small to matter there
_FAR_BELOW = -100.0  # [m] where unused ghosts wait


class RobotView:
    """One node per link; ghosts are one batched node per link."""

    def __init__(self, server: viser.ViserServer) -> None:
        scene = server.scene
        self._kinematics: Frankie | None = None
        self._links = [
            scene.add_glb(
                f"{ROOT}/link/{link}", glb_bytes(link), cast_shadow=False, receive_shadow=False, visible=False
            )
            for link in LINKS
        ]
        self._shadows = [
            scene.add_glb(f"{ROOT}/shadow/{part}", dark, visible=False, cast_shadow=False, receive_shadow=False)
            for part, dark in (("base", box_shadow_glb(0.7, 0.5, 0.3)), ("arm", round_shadow_glb(0.15, 1.0)))
        ]
        self._ghosts = [self._add_ghost(scene, link) for link in GHOST_LINKS]
        self.ghosts_on = True
        self._shown, self._shadows_shown = [True] * len(LINKS), [True, True]
        self.hand = np.eye(4)  # transform to the world, for a camera that rides on it

    def configure(self, profile: RobotProfile) -> None:
        """Another robot profile; of one without an arm only the base is drawn."""
        self._kinematics = Frankie(profile)
        self._shown = [profile.has_arm or link == LINKS[0] for link in LINKS]
        self._shadows_shown = [True, profile.has_arm]

    def update(self, tick: TickMessage) -> None:
        """Move the links to the pose of the tick."""
        if self._kinematics is None:
            return
        robot = tick.robot
        T = self._kinematics.link_transforms(np.array(robot.true_pose), np.array(robot.q), robot.gripper_width)
        self.hand = T[LINKS.index("panda_hand")]
        quaternions = matrices_wxyz(T[:, :3, :3])
        for handle, wxyz, position, shown in zip(self._links, quaternions, T[:, :3, 3], self._shown, strict=True):
            handle.wxyz, handle.position = wxyz, position
            if handle.visible != shown:
                handle.visible = shown
        x, y, heading = robot.true_pose
        for shadow, shown in zip(self._shadows, self._shadows_shown, strict=True):
            shadow.position = (x, y, LYING)
            if shadow.visible != shown:
                shadow.visible = shown
        self._shadows[0].wxyz = yaw_wxyz(heading)

    def update_ghosts(self, tick: TickMessage) -> None:
        """Set the ghosts along the local plan, with the arm as it is now."""
        if self._kinematics is None:
            return
        poses = (
            ghost_poses(np.array(tick.plan.local_poses).reshape(-1, 5)[:, :3]) if self.ghosts_on else np.zeros((0, 3))
        )
        positions = np.full((len(GHOST_LINKS), GHOSTS, 3), _FAR_BELOW, dtype=np.float32)
        quaternions = np.zeros((len(GHOST_LINKS), GHOSTS, 4), dtype=np.float32)
        quaternions[..., 0] = 1.0
        for index, pose in enumerate(poses):
            T = self._kinematics.link_transforms(pose, np.array(tick.robot.q), tick.robot.gripper_width)
            T = T[: len(GHOST_LINKS)]
            shown = self._shown[: len(GHOST_LINKS)]
            positions[shown, index], quaternions[:, index] = T[shown, :3, 3], matrices_wxyz(T[:, :3, :3])
        for handle, place, turn in zip(self._ghosts, positions, quaternions, strict=True):
            handle.batched_positions, handle.batched_wxyzs = place, turn

    @staticmethod
    def _add_ghost(scene: viser.SceneApi, link: str) -> viser.BatchedMeshHandle:
        vertices, faces = ghost_mesh(link)
        waiting = np.zeros((GHOSTS, 3))
        waiting[:, 2] = _FAR_BELOW
        return scene.add_batched_meshes_simple(
            f"{ROOT}/ghost/{link}",
            np.asarray(vertices, dtype=np.float32),
            faces,
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (GHOSTS, 1)),
            batched_positions=waiting,
            batched_colors=colours.GHOST,
            batched_opacities=np.linspace(0.34, 0.07, GHOSTS).astype(np.float32),
            opacity=0.99,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )


def ghost_poses(plan: NDArray[np.float64]) -> NDArray[np.float64]:
    """Up to `GHOSTS` poses of the plan, shape (j, 3), evenly spread and apart from the robot and each other."""
    chosen: list[int] = []
    last = 0
    for index in range(1, len(plan)):
        moved = np.hypot(*(plan[index, :2] - plan[last, :2])) + 0.25 * abs(plan[index, 2] - plan[last, 2])
        if moved >= GHOST_GAP:
            chosen.append(index)
            last = index
    if len(chosen) > GHOSTS:
        chosen = [chosen[i] for i in np.linspace(0, len(chosen) - 1, GHOSTS).round().astype(int)]
    return plan[chosen]
