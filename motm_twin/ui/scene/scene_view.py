"""The shared 3D scene: everything that is drawn in it, the plan of the base, and small marks on the task.

The plan has candidates by cost, the path to the chosen one and on to the next target, and the local plan. Marks are the
believed place of the target, points to drive to, and wrong beliefs.
"""

import dataclasses
import itertools
import math

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray
from viser.transforms import SO3

from motm_twin.bus.client import Grid
from motm_twin.bus.messages import PlacementMessage, ScanMessage, TickMessage
from motm_twin.model.geometry import Array
from motm_twin.model.kinematics import Frankie
from motm_twin.model.scene import Scene
from motm_twin.ui import colours
from motm_twin.ui.hub import LIDAR, STAA, Hub, Shown, Visitor
from motm_twin.ui.scene.body_view import BodyView, TrackView
from motm_twin.ui.scene.cameras import Cameras
from motm_twin.ui.scene.drag import SIGN, Drag, SelectionView, Spot, ring, spot_of
from motm_twin.ui.scene.furniture import FurnitureView, show_fixed
from motm_twin.ui.scene.light import NO_SHADOW, add_lights
from motm_twin.ui.scene.picking import CANDIDATE_HEIGHT, CANDIDATES, Clicks, Surroundings, drawn_candidates
from motm_twin.ui.scene.robot_view import AWAY, ComparisonView, GhostView, RobotView, add_batch, add_lines

PLAN, MARKS = "/plan", "/marks"
DASH = 0.08  # [m]
APART = 0.028  # [m] a candidate is shifted along its heading, so that both headings of a place can be seen
OFF = 0.01  # [m] a belief must be wrong by this much to be shown
MOST_BELIEFS, MOST_DRIVES = 16, 8
Points = list[list[float]]
_PATH_STYLES = {  # path: colour, height and width [m], dashed
    "global_path": (colours.WAY_THERE, 0.022, 0.032, False),
    "next_path": (colours.WAY_ON, 0.018, 0.028, False),
    "bezier": (colours.PLAN_LIGHT, 0.026, 0.02, False),
    "local_plan": (colours.PLAN, 0.030, 0.02, False),
    "staa_path": (colours.STAA_PATH, 0.016, 0.030, True),
    "inspected": (colours.WAY_THERE, 0.034, 0.026, True),
    "inspected_next": (colours.WAY_ON, 0.034, 0.026, True),
}


class CandidateView:
    """All candidates as one batched mesh: a ball with a nose that points along the heading."""

    def __init__(self, server: viser.ViserServer) -> None:
        scene, grey, none = server.scene, np.full((CANDIDATES, 3), 128, dtype=np.uint8), np.full(CANDIDATES, 1e-3)
        path = f"{PLAN}/candidates"
        self._handle = add_batch(scene, path, _pointed_ball(), CANDIDATES, grey, batched_scales=none)
        self._cost = scene.add_label(f"{path}/cost", "", visible=False, **SIGN)
        self._goal = add_lines(scene, f"{PLAN}/goal", colours.TARGET, 0.022, _goal_mark())
        self._key: tuple = ()

    def update(self, placement: PlacementMessage, on: bool, picked: int | None) -> None:
        """Place and colour the candidates; the chosen and the picked one are larger."""
        key = (placement, on, picked)
        if key == self._key:
            return
        self._key = key
        drawn = drawn_candidates(placement) if on else np.zeros(0, dtype=int)
        count = len(drawn)
        positions, scales = np.tile(AWAY, (CANDIDATES, 1)), np.full(CANDIDATES, 1e-3)
        yaws, tones = np.zeros(CANDIDATES), np.tile(np.array(colours.REJECTED, dtype=np.uint8), (CANDIDATES, 1))
        if count:
            poses = np.array(placement.poses)[drawn]
            yaws[:count] = poses[:, 2]
            shift = APART * np.stack([np.cos(yaws[:count]), np.sin(yaws[:count])], axis=1)
            positions[:count] = np.column_stack([poses[:, :2] + shift, np.full(count, CANDIDATE_HEIGHT)])
            viable = np.array([not placement.rejected[index] for index in drawn])
            scales[:count] = np.where(viable, 1.0, 0.5)
            tones[:count][viable] = colours.scale(relative_cost(placement)[drawn][viable])
            for index, factor in ((placement.chosen, 1.8), (picked, 1.5)):
                scales[:count][drawn == index] *= factor
        handle = self._handle
        handle.batched_positions = positions.astype(np.float32)
        handle.batched_wxyzs = SO3.from_z_radians(yaws).wxyz.astype(np.float32)
        handle.batched_scales, handle.batched_colors = scales, tones
        self._cost.visible = picked is not None and picked in drawn
        if self._cost.visible and picked is not None:
            x, y, _ = placement.poses[picked]
            self._cost.text, self._cost.position = cost_of(placement, picked), (x, y, CANDIDATE_HEIGHT + 0.06)
        self._goal.visible = on and placement.mode != "none"
        if self._goal.visible:
            x, y, heading = (value or 0.0 for value in placement.goal)
            self._goal.position, self._goal.wxyz = (x, y, 0.02), SO3.from_z_radians(heading).wxyz


class PlanView:
    """Paths and candidates of a tick."""

    def __init__(self, server: viser.ViserServer) -> None:
        add = server.scene
        self._lines = {name: add_lines(add, f"{PLAN}/{name}", look[0], look[2]) for name, look in _PATH_STYLES.items()}
        self.candidates = CandidateView(server)
        self.on, self.staa_on = True, False
        self.picked: int | None = None

    def update(self, tick: TickMessage) -> None:
        """Draw the plan of a tick."""
        plan, found = tick.plan, tick.inspected
        inspected = found if found is not None and found.candidate == self.picked else None
        paths: dict[str, Points] = {
            "global_path": plan.global_path,
            "next_path": plan.next_path,
            "bezier": plan.bezier,
            "local_plan": [pose[:2] for pose in plan.local_poses],
            "staa_path": plan.staa_path if self.staa_on else [],
            "inspected": inspected.path if inspected else [],
            "inspected_next": inspected.next_path if inspected else [],
        }
        for name, points in paths.items():
            line, (_, height, _, dashed) = self._lines[name], _PATH_STYLES[name]
            line.visible = len(points) > 1 and (self.on or name.startswith("inspected"))
            if line.visible:
                flat = np.asarray(points, dtype=np.float32)
                pieces = dashes(flat) if dashed else np.stack([flat[:-1], flat[1:]], axis=1)
                heights = np.full((*pieces.shape[:2], 1), height, dtype=np.float32)
                line.points = np.concatenate([pieces, heights], axis=2)
        self.candidates.update(tick.placement, self.on, self.picked)


def cost_of(placement: PlacementMessage, index: int) -> str:
    """Costs of a candidate, or the reason of its rejection, in a few words."""
    here, onward = placement.cost_current[index], placement.cost_next[index]
    if placement.rejected[index] or here is None:
        return placement.rejected[index] or "not possible"
    there = f"{here:.1f} s to get there"
    return there if onward is None else f"{there}, {onward:.1f} s on to the next target"


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


def _pointed_ball() -> tuple[np.ndarray, np.ndarray]:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.028)
    nose = trimesh.creation.cone(radius=0.02, height=0.058, sections=12)
    nose.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    nose.apply_translation((0.012, 0.0, 0.0))
    return _joined(ball, nose)


def _goal_mark() -> NDArray[np.float32]:
    """The outline of the base with an arrow, at the origin; shape (n, 2, 3)."""
    outline = [(-0.35, -0.25), (0.35, -0.25), (0.35, 0.25), (-0.35, 0.25), (-0.35, -0.25)]
    arrow = [((0.0, 0.0), (0.28, 0.0)), ((0.28, 0.0), (0.18, 0.08)), ((0.28, 0.0), (0.18, -0.08))]
    pieces = [*itertools.pairwise(outline), *arrow]
    return np.array([[(*start, 0.0), (*end, 0.0)] for start, end in pieces], dtype=np.float32)


class MarksView:
    """Three nodes, however many marks there are."""

    def __init__(self, server: viser.ViserServer) -> None:
        add = server.scene
        self._target = add_lines(add, f"{MARKS}/target", colours.TARGET, 0.010, ring(0.06))
        self._drives = add_batch(add, f"{MARKS}/drive_to", _flag(), MOST_DRIVES, colours.TARGET)
        cube = trimesh.creation.box((1.0, 1.0, 1.0))
        self._beliefs = add_batch(
            add, f"{MARKS}/beliefs", (cube.vertices, cube.faces), MOST_BELIEFS, colours.TARGET, opacity=0.45,
            batched_scales=np.full(MOST_BELIEFS, 0.04),
        )  # fmt: skip

    def update(self, tick: TickMessage, surroundings: Surroundings) -> None:
        """Mark the target of a tick, the points to drive to, and wrong beliefs."""
        spot = target_spot(tick, surroundings)
        self._target.visible = spot is not None
        if spot is not None:
            self._target.position = (round(spot.x, 3), round(spot.y, 3), round(spot.z, 3) + 0.008)
            self._target.points = ring(round(0.7 * spot.radius, 3))
        drives = np.array([(*point, 0.0) for point in drive_points(tick)])
        for handle, places, most in (
            (self._drives, drives, MOST_DRIVES),
            (self._beliefs, believed(tick), MOST_BELIEFS),
        ):
            positions = np.tile(np.array(AWAY, dtype=np.float32), (most, 1))
            if len(places):
                positions[: len(places)] = places[:most]
            handle.batched_positions = positions


def target_spot(tick: TickMessage, surroundings: Surroundings) -> Spot | None:
    """Believed place of the target to pick or place at; None when the robot does neither."""
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
    """Targets [m] of the drives that are left."""
    ended, left = ("done", "failed", "skipped"), tick.tasks[tick.task_index :]
    points = [task.target for task in left if task.kind == "drive_to" and task.status not in ended]
    return [(float(x), float(y)) for x, y in (point.strip("()").split(",") for point in points)]


def believed(tick: TickMessage) -> np.ndarray:
    """Believed places [m] of cubes that are truly elsewhere, shape (n, 3)."""
    true = {item.name: item.position for item in tick.objects}
    known = [(belief.position, true[belief.name]) for belief in tick.beliefs if belief.name in true]
    return np.array([place for place, real in known if math.dist(place, real) > OFF]).reshape(-1, 3)


def _flag() -> tuple[np.ndarray, np.ndarray]:
    """A pin that stands on its point, with a disc on the floor."""
    cone = trimesh.creation.cone(radius=0.05, height=0.14, sections=20)
    cone.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0]))
    cone.apply_translation((0.0, 0.0, 0.16))
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.055)
    ball.apply_translation((0.0, 0.0, 0.18))
    disc = trimesh.creation.annulus(r_min=0.12, r_max=0.15, height=0.006, sections=32)
    disc.apply_translation((0.0, 0.0, 0.02))
    return _joined(cone, ball, disc)


def _joined(*meshes: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of several meshes as one."""
    whole = trimesh.util.concatenate(meshes)
    return whole.vertices, whole.faces


CLOCK = "/clock"  # node whose position holds the time [s] and run of a frame, for the page's script
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
        """End the thread that sends drags."""
        self._drag.stop()

    def leave(self, visitor: Visitor) -> None:
        """Release everything that a departed visitor held."""
        self._drag.leave(visitor)

    def draw(self, shown: Shown, dt: float, *, slow: bool) -> None:
        """Draw one frame, all from one period; ``slow``: also changes within the period, such as a choice."""
        if shown.scene is not None and shown.scene is not self._scene:
            self._show_scene(shown.scene)
        tick, surroundings = shown.tick, self._surroundings
        if tick is None or surroundings is None:
            return
        surroundings.update(tick)
        self.clicks.surroundings, self.clicks.tick = surroundings, tick
        self._forget_candidate(tick)
        fresh = tick is not self._drawn
        live = self._hub.what_if.watched is None  # else two compared runs are watched, with their Temis
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
            self._clock.position = (tick.time, tick.run, 0.0)  # last: it completes the frame
        self._drawn = tick
        spot = target_spot(tick, surroundings)
        target = None if spot is None else np.array([spot.x, spot.y, spot.z + 0.5 * spot.height])
        self.cameras.update(np.array(tick.robot.true_pose), self._robot.hand, dt, ride=fresh, target=target)

    def _forget_candidate(self, tick: TickMessage) -> None:
        """Forget the clicked candidate when run or task has changed: its number then stands for another pose."""
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
        moved_in = self._scene is None or _room(scene) != _room(self._scene)
        self._scene, self._drawn = scene, None
        self._surroundings = self._drag.surroundings = Surroundings(scene)
        if moved_in:  # else a browser would show an empty room until it has read the same meshes again
            show_fixed(self._server.scene, scene)
            self._furniture.show(scene)
        for part in (self._bodies, self.cameras):
            part.show(scene)
        self._robot.kinematics = self._ghosts.kinematics = self._others.kinematics = Frankie(scene.robot)
        self._hub.view.picked, self._hub.view.selected = None, ""
        self._hub.view.aim_at_nothing()


def _room(scene: Scene) -> tuple:
    """The parts of a scene from which floor and furniture are drawn."""
    return scene.bounds, scene.solids, scene.bins, scene.bumps


def hits(scan: ScanMessage, height: float) -> Array:
    """End points [m] of the beams that hit something, in the world, shape (n, 3)."""
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
    """The occupancy grid as the ground: transparent where it is free, light to dark brown towards obstacles."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._scene, self._table = server.scene, colours.ground_table()
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
