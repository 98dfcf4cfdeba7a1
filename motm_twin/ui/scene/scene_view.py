"""The shared 3D scene: everything that is drawn in it."""

import math

import numpy as np
import viser

from motm_twin.bus.client import Grid
from motm_twin.bus.messages import ScanMessage, TickMessage
from motm_twin.model.geometry import Array
from motm_twin.model.kinematics import Frankie
from motm_twin.model.scene import Scene
from motm_twin.ui import colours
from motm_twin.ui.colours import ground_table
from motm_twin.ui.hub import LIDAR, STAA, Hub, Shown, Visitor
from motm_twin.ui.scene.body_view import BodyView, TrackView
from motm_twin.ui.scene.cameras import Cameras
from motm_twin.ui.scene.drag import Drag, SelectionView
from motm_twin.ui.scene.furniture import FurnitureView, show_fixed
from motm_twin.ui.scene.light import NO_SHADOW, add_lights
from motm_twin.ui.scene.picking import Clicks, Surroundings
from motm_twin.ui.scene.plan_view import MarksView, PlanView, target_spot
from motm_twin.ui.scene.robot_view import ComparisonView, GhostView, RobotView

CLOCK = "/clock"  # node whose position is the time [s] and run of a picture, for the page's script
MAP = "/map"  # node of the ground
MAP_HEIGHT = 0.002  # [m] above the floor


class SceneView:
    """Draws what is `Shown`. ``draw`` is called from one thread, thirty times a second."""

    def __init__(self, server: viser.ViserServer, hub: Hub) -> None:
        self._server, self._hub = server, hub
        self._drag = Drag(hub)
        add_lights(server.scene)
        self._robot, self._ghosts = RobotView(server), GhostView(server)
        self._furniture = FurnitureView(server, self._drag)
        self._bodies, self._map = BodyView(server, self._drag), MapView(server)
        self._tracks = TrackView(server)
        self._plan, self._marks, self._others = PlanView(server), MarksView(server), ComparisonView(server)
        self._selection = SelectionView(server, hub, self._drag)
        self.clicks = Clicks(server, hub)
        self.cameras = Cameras(server)
        self._scene: Scene | None = None
        self._surroundings: Surroundings | None = None
        self._lidar = server.scene.add_point_cloud(
            "/lidar", np.zeros((1, 3), dtype=np.float32), colours.LIDAR, point_size=0.035, point_shape="circle",
            point_shading="flat", precision="float32", visible=False,
        )  # fmt: skip
        self._clock = server.scene.add_frame(CLOCK, show_axes=False)
        self._drawn: TickMessage | None = None
        self._live = True  # the twin's own run is shown
        self._job = (-1, -1)  # run and task, whose candidates are numbered

    def stop(self) -> None:
        """Let go of everything."""
        self._drag.stop()

    def leave(self, visitor: Visitor) -> None:
        """A visitor is gone: everything that it held is let go."""
        self._drag.leave(visitor)

    def draw(self, shown: Shown, dt: float, *, slow: bool) -> None:
        """Draw one picture, all of one period; ``slow``: also what has changed within the period, such as a choice."""
        if shown.scene is not None and shown.scene is not self._scene:
            self._show_scene(shown.scene)
        tick, surroundings = shown.tick, self._surroundings
        if tick is None or surroundings is None:
            return
        surroundings.update(tick)
        self.clicks.surroundings, self.clicks.tick = surroundings, tick
        self._forget_candidate(tick)
        fresh = tick is not self._drawn
        live = self._hub.what_if.watched is None  # else two other runs are watched, and their Temis
        if live != self._live:
            self._live, fresh = live, True
            for part in (self._bodies, self._ghosts, self._plan, self._robot, self._tracks):
                part.on = live
        with self._server.atomic():
            if fresh:
                self._robot.update(tick)
            self._bodies.update(tick)
            self._furniture.update(tick)
            self._ghosts.propose(shown.view.going if shown.live else None, tick)
            self._selection.update(shown.view.selected, tick, surroundings, live=shown.live)
            if fresh or slow:
                self._draw_plan(shown, tick, surroundings)
            self._clock.position = (tick.time, tick.run, 0.0)  # the last: what has come before it is one picture
        self._drawn = tick
        spot = target_spot(tick, surroundings)
        target = None if spot is None else np.array([spot.x, spot.y, spot.z + 0.5 * spot.height])
        self.cameras.update(np.array(tick.robot.true_pose), self._robot.hand, dt, ride=fresh, target=target)

    def _forget_candidate(self, tick: TickMessage) -> None:
        """Of another task: the number of the one that was clicked stands for another place there."""
        job, view = (tick.run, tick.task_index), self._hub.view
        if job != self._job and view.picked is not None:
            view.picked = None
            self._hub.inspect()
        self._job = job

    def _draw_plan(self, shown: Shown, tick: TickMessage, surroundings: Surroundings) -> None:
        if self._hub.shows(STAA) != self._plan.staa_on:
            self._plan.staa_on = not self._plan.staa_on
            self._hub.inspect()
        sweep = self._hub.client.scan() if shown.live and self._hub.shows(LIDAR) else None
        points = np.zeros((0, 3)) if sweep is None else hits(sweep, surroundings.now.robot.lidar.z)
        self._lidar.visible = len(points) > 0
        if len(points):
            self._lidar.points = points.astype(np.float32)
        self._plan.picked = shown.view.picked
        self._ghosts.update(tick, target_spot(tick, surroundings))
        self._plan.update(tick)
        self._marks.update(tick, surroundings)
        self._others.update(self._hub.what_if.others(tick.time, tick.run))
        self._bodies.update_trails()
        self._tracks.update(tick)
        self._map.update(shown.grid)

    def _show_scene(self, scene: Scene) -> None:
        self._scene, self._drawn = scene, None
        self._surroundings = self._drag.surroundings = Surroundings(scene)
        show_fixed(self._server.scene, scene)
        for part in (self._furniture, self._bodies, self.cameras):
            part.show(scene)
        self._robot.kinematics = self._ghosts.kinematics = self._others.kinematics = Frankie(scene.robot)
        self._hub.view.picked, self._hub.view.selected = None, ""
        self._hub.view.aim_at_nothing()


def hits(scan: ScanMessage, height: float) -> Array:
    """Points [m] where beams have ended, shape (n, 3), in the world."""
    ranges = np.array(scan.ranges, dtype=float)  # nan for None
    x, y, heading = scan.pose
    angles = scan.angle_min + scan.angle_step * np.arange(len(ranges)) + heading
    c, s = math.cos(heading), math.sin(heading)
    u, v = scan.origin
    points = np.column_stack([
        x + c * u - s * v + ranges * np.cos(angles), y + s * u + c * v + ranges * np.sin(angles),
        np.full(len(ranges), height),
    ])  # fmt: skip
    return points[np.isfinite(ranges)]


class MapView:
    """The occupancy grid as a soft ground: clear where it is free, green to red towards obstacles."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._scene, self._table = server.scene, ground_table()
        self._shown: Grid | None = None
        self._handle: viser.ImageHandle | None = None
        self._key: tuple = ()

    def update(self, grid: Grid | None) -> None:
        """Show this grid; its image is replaced when a new one has arrived."""
        if grid is None or grid is self._shown:
            return
        self._shown, info = grid, grid.info
        picture, key = self._table[grid.cells], (info.width, info.height, info.resolution, tuple(info.origin))
        if self._handle is not None and key == self._key:
            self._handle.image = picture
            return
        self._key = key
        width, height = info.width * info.resolution, info.height * info.resolution
        middle = (info.origin[0] + width / 2, info.origin[1] + height / 2, MAP_HEIGHT)
        self._handle = self._scene.add_image(MAP, picture, width, height, format="png", position=middle, **NO_SHADOW)
