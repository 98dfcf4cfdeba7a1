"""What never moves: light, floor, ground, sky, walls and other fixed solids."""

import viser

from motm_twin.model.furniture import pieces
from motm_twin.model.scene import Scene
from motm_twin.ui.backdrop import floor_glb, ground_glb, sky_glb
from motm_twin.ui.furniture import blocks, glb, solids_mesh
from motm_twin.ui.light import Lights
from motm_twin.ui.shadows import shadow_glb

ROOT = "/scene"
SHADOW_HEIGHT = 0.005  # [m] above the floor


class SceneView:
    """Draws a scene once; another scene replaces it."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        Lights(server)

    def show(self, scene: Scene) -> None:
        """Draw this scene instead of the last one."""
        self._server.scene.remove_by_name(ROOT)
        x_min, y_min, x_max, y_max = scene.bounds
        centre = ((x_min + x_max) / 2, (y_min + y_max) / 2)
        self._add("floor", floor_glb(scene))
        self._add("ground", ground_glb(centre))
        self._add("sky", sky_glb(centre))
        movable = {name for piece in pieces(scene).values() for name in piece.solids}
        fixed = [solid for solid in scene.solids if solid.name not in movable]
        if fixed:
            self._add("fixed", glb(solids_mesh(fixed)))
            self._add("shadow", shadow_glb(blocks(fixed, (0.0, 0.0))), SHADOW_HEIGHT)

    def _add(self, name: str, mesh: bytes, height: float = 0.0) -> None:
        self._server.scene.add_glb(
            f"{ROOT}/{name}", mesh, position=(0.0, 0.0, height), cast_shadow=False, receive_shadow=False
        )
