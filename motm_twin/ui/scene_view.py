"""What does not move: floor, furniture, bins, light."""

import viser

from motm_twin.model.scene import Scene
from motm_twin.ui.furniture import bin_mesh, floor_glb, glb, solid_mesh
from motm_twin.ui.rotation import yaw_wxyz

ROOT = "/scene"
_LIGHTS = (  # name, colour, intensity, where it comes from
    ("sun", (255, 244, 228), 1.75, (-3.0, -5.0, 8.0)),
    ("fill", (222, 234, 255), 0.7, (5.0, 3.0, 4.0)),
)


class SceneView:
    """Draws a scene once; another scene replaces it."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(enabled=False)
        server.scene.configure_environment_map(None)  # twenty times the cost of lights where there is no graphics card
        server.scene.configure_fog(
            near=30.0, far=90.0, enabled=False
        )  # with fog, a hovered candidate stops the drawing
        server.scene.add_light_hemisphere(
            "/light/sky", sky_color=(255, 255, 255), ground_color=(196, 188, 178), intensity=1.45
        )
        for name, colour, strength, place in _LIGHTS:
            server.scene.add_light_directional(
                f"/light/{name}", color=colour, intensity=strength, position=place, cast_shadow=False
            )

    def show(self, scene: Scene) -> None:
        """Draw this scene instead of the last one."""
        add = self._server.scene
        add.remove_by_name(ROOT)
        self._add(f"{ROOT}/floor", floor_glb(scene))
        for number, solid in enumerate(scene.solids):
            self._add(f"{ROOT}/solid/{number}", glb(solid_mesh(solid)))
        for number, box in enumerate(scene.bins):
            self._add(f"{ROOT}/bin/{number}", glb(bin_mesh(box)))
            add.add_label(
                f"{ROOT}/bin/{number}/name", box.name, position=(*box.centre, box.rim_z + 0.12), wxyz=yaw_wxyz(0.0),
                font_screen_scale=0.8, anchor="bottom-center", depth_test=True,
            )  # fmt: skip

    def _add(self, name: str, glb: bytes) -> None:
        self._server.scene.add_glb(name, glb, cast_shadow=False, receive_shadow=False)
