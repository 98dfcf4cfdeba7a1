"""Furniture that can be moved: one frame per piece, with its bins and its shadow; what is not in a tick is at home."""

from dataclasses import dataclass

import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.model.furniture import Piece, pieces
from motm_twin.model.scene import PlanarPose, Scene
from motm_twin.ui.drag import Drag
from motm_twin.ui.furniture import bin_mesh, blocks, glb, solids_mesh
from motm_twin.ui.rotation import yaw_wxyz
from motm_twin.ui.scene_view import SHADOW_HEIGHT
from motm_twin.ui.shadows import shadow_glb

ROOT = "/furniture"
LABEL_SIZE = 0.78
LABEL_GAP = 0.10  # [m] above the rim of a bin
SLACK = 0.04  # [m] the hand must move before a piece does: one that is only touched stays where it is


@dataclass
class _Drawn:
    piece: Piece
    frame: viser.FrameHandle
    mesh: viser.GlbHandle
    pose: PlanarPose
    gone: bool = False


class FurnitureView:
    """One node per piece moves; its parts ride along."""

    def __init__(self, server: viser.ViserServer, drag: Drag) -> None:
        self._server, self._drag = server, drag
        self._drawn: dict[str, _Drawn] = {}

    def show(self, scene: Scene) -> None:
        """Draw the pieces of this scene instead of those of the last one."""
        self._server.scene.remove_by_name(ROOT)
        self._drawn = {name: self._add(scene, piece) for name, piece in pieces(scene).items()}
        for number, box in enumerate(scene.bins):  # that stand on something fixed
            if not any(box.name in drawn.piece.bins for drawn in self._drawn.values()):
                self._add_bin(f"{ROOT}/bin{number}", scene, box.name, (0.0, 0.0))

    def update(self, tick: TickMessage) -> None:
        """Put the pieces where the tick, or a hand, has them."""
        moved = {body.name: (body.position[0], body.position[1], body.yaw) for body in tick.furniture}
        for name, drawn in self._drawn.items():
            pose, held = moved.get(name, (*drawn.piece.centre, 0.0)), self._drag.held(name)
            if held is not None:
                pose = (held.x, held.y, pose[2] if held.heading is None else held.heading)
            if pose != drawn.pose:
                drawn.pose = pose
                drawn.frame.position, drawn.frame.wxyz = (pose[0], pose[1], 0.0), yaw_wxyz(pose[2])
            gone = name in tick.removed
            if gone != drawn.gone:
                drawn.gone = gone
                drawn.frame.visible = not gone

    def _add(self, scene: Scene, piece: Piece) -> _Drawn:
        path, add = f"{ROOT}/{piece.name}", self._server.scene
        solids = [solid for solid in scene.solids if solid.name in piece.solids]
        frame = add.add_frame(path, show_axes=False, position=(*piece.centre, 0.0))
        mesh = add.add_glb(
            f"{path}/mesh", glb(solids_mesh(solids, piece.centre)), cast_shadow=False, receive_shadow=False
        )
        shadow = shadow_glb(blocks(solids, piece.centre))
        add.add_glb(
            f"{path}/shadow", shadow, position=(0.0, 0.0, SHADOW_HEIGHT), cast_shadow=False, receive_shadow=False
        )
        for number, name in enumerate(piece.bins):
            self._add_bin(f"{path}/bin{number}", scene, name, piece.centre)
        drawn = _Drawn(piece, frame, mesh, (*piece.centre, 0.0))
        self._drag.attach(mesh, piece.name, where=lambda: drawn.pose[:2], slack=SLACK)
        return drawn

    def _add_bin(self, path: str, scene: Scene, name: str, centre: tuple[float, float]) -> None:
        box = next(box for box in scene.bins if box.name == name)
        add = self._server.scene
        add.add_glb(path, glb(bin_mesh(box, centre)), cast_shadow=False, receive_shadow=False)
        add.add_label(
            f"{path}/name", name, font_screen_scale=LABEL_SIZE, anchor="bottom-center", depth_test=True,
            position=(box.centre[0] - centre[0], box.centre[1] - centre[1], box.rim_z + LABEL_GAP),
        )  # fmt: skip
