"""The shared 3D scene: everything that is drawn, and what clicks and drags in it mean."""

import threading

import numpy as np
import viser

from motm_twin.model.scene import Scene
from motm_twin.ui.body_view import BodyView
from motm_twin.ui.camera import Cameras
from motm_twin.ui.drag import Drag
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.map_view import MapView
from motm_twin.ui.plan_view import PlanView
from motm_twin.ui.robot_view import RobotView
from motm_twin.ui.scene_view import SceneView


class Stage:
    """Draws what is `Shown`. ``draw`` is called from one thread, thirty times a second."""

    def __init__(self, server: viser.ViserServer, hub: Hub) -> None:
        self._server, self._hub = server, hub
        self._lock = threading.Lock()
        self._drag = Drag(hub)
        self._scene_view, self._robot = SceneView(server), RobotView(server)
        self._bodies, self._map = BodyView(server, self._drag), MapView(server)
        self._plan = PlanView(server, hub.watching(self._pick))
        self.cameras = Cameras(server)
        self._scene: Scene | None = None

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
        if tick is None or self._scene is None:
            return
        layers = shown.view.layers
        with self._server.atomic():
            self._robot.update(tick)
            self._bodies.update(tick)
        if slow:
            self._robot.ghosts_on, self._bodies.trails_on = layers["Ghosts"], layers["Trails"]
            self._plan.candidates_on, self._plan.paths_on = layers["Candidates"], layers["Paths"]
            self._plan.picked = shown.view.picked
            self._map.on = layers["Occupancy grid"]
            with self._server.atomic():
                self._robot.update_ghosts(tick)
                self._plan.update(tick)
            self._bodies.update_trails()
            self._map.update(self._hub.client.grid())
        self.cameras.update(np.array(tick.robot.true_pose), dt)

    def _show_scene(self, scene: Scene) -> None:
        self._scene = scene
        self._scene_view.show(scene)
        self._robot.configure(scene.robot)
        self._bodies.show(scene)
        self.cameras.show(scene)
        self._hub.view.picked = None
        self._hub.view.selected = ""

    def _pick(self, event: viser.SceneNodePointerEvent, visitor: Visitor) -> None:
        if event.instance_index is None or not self._hub.drives(visitor):
            return
        view = self._hub.view
        view.picked = None if view.picked == event.instance_index else event.instance_index
        self._hub.inspect()
