"""The shared 3D scene: everything that is drawn, and what clicks and drags in it mean."""

import numpy as np
import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.model.scene import Scene
from motm_twin.ui.aim import Ray, Surroundings
from motm_twin.ui.body_view import BodyView
from motm_twin.ui.camera import Cameras
from motm_twin.ui.drag import Drag
from motm_twin.ui.furniture_view import FurnitureView
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.map_view import MapView
from motm_twin.ui.marks_view import MarksView
from motm_twin.ui.other_view import OtherView
from motm_twin.ui.plan_view import PlanView
from motm_twin.ui.pointing import Pointing
from motm_twin.ui.robot_view import RobotView
from motm_twin.ui.scene_view import SceneView
from motm_twin.ui.selection_view import SelectionView

STAA_LAYER = "Unmodified STAA* path"


class Stage:
    """Draws what is `Shown`. ``draw`` is called from one thread, thirty times a second."""

    def __init__(self, server: viser.ViserServer, hub: Hub) -> None:
        self._server, self._hub = server, hub
        self._drag = Drag(hub)
        self._drag.surface = self._surface
        self._scene_view, self._robot = SceneView(server), RobotView(server)
        self._furniture = FurnitureView(server, self._drag)
        self._bodies, self._map = BodyView(server, self._drag), MapView(server)
        self._plan, self._marks, self._others = PlanView(server), MarksView(server), OtherView(server)
        self._selection = SelectionView(server, hub, self._drag)
        self._pointing = Pointing(server, hub, self._drag)
        self.cameras = Cameras(server)
        self._scene: Scene | None = None
        self._surroundings: Surroundings | None = None
        self._drawn: TickMessage | None = None

    def stop(self) -> None:
        """Let go of everything."""
        self._drag.stop()

    def leave(self, visitor: Visitor) -> None:
        """A visitor is gone: what was held is let go."""
        self._drag.leave(visitor)

    def draw(self, shown: Shown, dt: float, *, slow: bool) -> None:
        """Draw one picture; ``slow`` parts (plan, map, ghosts) only when asked to."""
        if shown.scene is not None and shown.scene is not self._scene:
            self._show_scene(shown.scene)
        tick = shown.tick
        if tick is None or self._scene is None or self._surroundings is None:
            return
        self._drag.live = shown.live
        self._surroundings.update(tick)
        self._pointing.surroundings, self._pointing.tick = self._surroundings, tick
        with self._server.atomic():
            if tick is not self._drawn:
                self._robot.update(tick)
            self._bodies.update(tick)
            self._furniture.update(tick)
            self._selection.update(shown.view.selected, tick, self._surroundings, live=shown.live)
        self._drawn = tick
        if slow:
            self._draw_slow(shown, tick, self._surroundings)
        self.cameras.update(np.array(tick.robot.true_pose), self._robot.hand, dt)

    def _draw_slow(self, shown: Shown, tick: TickMessage, surroundings: Surroundings) -> None:
        view = shown.view
        layers = view.layers
        if layers[STAA_LAYER] != view.staa_path:
            view.staa_path = layers[STAA_LAYER]
            self._hub.inspect()
        live = self._hub.what_if.watched is None  # else two other runs are watched, and who is about in them
        self._bodies.movers_on = live
        self._robot.ghosts_on, self._bodies.trails_on = live and layers["Ghosts"], live and layers["Trails"]
        self._plan.candidates_on, self._plan.paths_on = live and layers["Candidates"], live and layers["Paths"]
        self._plan.staa_on, self._plan.picked = live and view.staa_path, view.picked
        self._map.on = layers["Occupancy grid"]
        with self._server.atomic():
            self._robot.update_ghosts(tick)
            self._plan.update(tick)
            self._marks.update(tick, surroundings)
            self._others.update(self._hub.what_if.others(tick.time, tick.run))
        self._bodies.update_trails()
        self._map.update(shown.grid)

    def _show_scene(self, scene: Scene) -> None:
        self._scene, self._surroundings, self._drawn = scene, Surroundings(scene), None
        self._scene_view.show(scene)
        self._furniture.show(scene)
        self._robot.configure(scene.robot)
        self._others.configure(scene.robot)
        self._bodies.show(scene)
        self.cameras.show(scene)
        self._hub.view.picked = None
        self._hub.view.selected = ""

    def _surface(self, ray: Ray) -> np.ndarray | None:
        return None if self._surroundings is None else self._surroundings.surface(ray)
