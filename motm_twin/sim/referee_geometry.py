"""The referee's own geometry: robot shapes from ``frankie.urdf`` in pinocchio, the world and self-contact."""

import functools
import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from motm_twin.model.assets import robot_urdf, web_assets_dir
from motm_twin.model.compiler import njit
from motm_twin.model.exact import product
from motm_twin.model.geometry import Array, about_z
from motm_twin.model.profile import Footprint, RobotProfile
from motm_twin.sim.kernels import Index, polygon_distance, put_rectangle
from motm_twin.sim.solids import Solids

HELD = "held"  # body name of the slot for a held cube
_ROOT_HALF = math.sqrt(0.5)


class RobotShapes:
    """Base box, link hulls, hand and finger boxes of the robot, and a slot for the held cube, last."""

    def __init__(self, profile: RobotProfile) -> None:
        """Shapes for one profile: its footprint is the base body, its mount carries the arm."""
        xml = ET.tostring(robot_urdf(profile), encoding="unicode")
        self._model = pin.buildModelFromXML(xml, pin.JointModelPlanar())
        geometry = pin.buildGeomFromUrdfString(
            self._model, xml, pin.GeometryType.COLLISION, package_dirs=[str(web_assets_dir().parent)]
        )
        if not profile.has_arm:
            frames = self._model.frames
            for item in [i.name for i in geometry.geometryObjects if frames[i.parentFrame].name != "base_link"]:
                geometry.removeGeometryObject(item)
        self._data, self._geometry, self._geometry_data = self._model.createData(), geometry, geometry.createData()
        placements = self._geometry_data.oMg
        self._rotations = _row([T.rotation for T in placements])  # a view that pinocchio keeps up to date
        self._translations = _row([T.translation for T in placements])
        self._configuration = pin.neutral(self._model)
        bodies = [self._model.frames[item.parentFrame].name for item in geometry.geometryObjects]
        self.bodies = tuple("base" if name == "base_link" else name for name in [*bodies, HELD])
        self.shapes = [_convex(item.geometry) for item in geometry.geometryObjects]
        self.centres = np.zeros((len(self.bodies), 3))
        self.radii = np.zeros(len(self.bodies))
        for i, shape in enumerate(self.shapes):
            shape.computeLocalAABB()
            self.centres[i], self.radii[i] = shape.aabb_center, shape.aabb_radius
        self.shapes.append(cube(1.0))
        self._unplaced = np.tile(np.eye(4), (len(self.bodies), 1, 1))
        self._in_links = []  # for each shape its link, and its transform in the link
        for item in geometry.geometryObjects:
            frame = self._model.frames[item.parentFrame]
            local = (frame.placement.inverse() * item.placement).homogeneous
            self._in_links.append((frame.name, local))

    def place(self, pose: Array, q: Array, width: float) -> Array:
        """World transforms of all shapes but the held cube, whose slot is the identity; shape (n, 4, 4)."""
        configuration = self._configuration
        configuration[0], configuration[1] = pose[0], pose[1]
        configuration[2], configuration[3] = math.cos(pose[2]), math.sin(pose[2])
        configuration[4:11] = q
        configuration[11:] = 0.5 * width
        pin.forwardKinematics(self._model, self._data, configuration)
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data)
        T = self._unplaced.copy()
        T[:-1, :3, :3], T[:-1, :3, 3] = self._rotations, self._translations
        return T

    def place_links(self, links: Mapping[str, Array]) -> Array:
        """`place` from given transforms (4, 4) of the links in the world, for example of a tilted robot."""
        T = self._unplaced.copy()
        for i, (link, local) in enumerate(self._in_links):
            T[i] = product(links[link], local)
        return T


@functools.cache
def cube(side: float) -> coal.Box:
    """The shape of a cube."""
    return coal.Box(side, side, side)


def _row(items: Sequence[Array]) -> Array:
    """A single view of arrays at equal distances in memory.

    Asking pinocchio for each placement takes a hundred times as long as the kinematics.
    """
    if len(items) == 1:
        return items[0][None]
    places = [item.__array_interface__["data"][0] for item in items]
    step = places[1] - places[0]
    assert all(place == places[0] + i * step for i, place in enumerate(places))
    return np.lib.stride_tricks.as_strided(items[0], (len(items), *items[0].shape), (step, *items[0].strides))


def _convex(shape: coal.CollisionGeometry) -> coal.CollisionGeometry:
    if isinstance(shape, coal.BVHModelBase):
        shape.buildConvexHull(True, "Qt")
        return shape.convex
    return shape


class Surroundings:
    """Everything the robot may touch, one column each: polygons, its own base, discs, agents, cubes, the floor."""

    def __init__(
        self,
        solids: Solids,
        agents: Sequence[tuple[str, float, float]],
        cubes: Sequence[tuple[str, float]],
        base: tuple[coal.CollisionGeometry, float],
        previous: "Surroundings | None" = None,
    ) -> None:
        """The world as it stands; agents are name, radius, height [m], cubes name and side [m].

        ``base``: its shape and its top [m]. Shapes of ``previous`` are reused where they are equal.
        """
        base_shape, base_top = base
        self.solids = solids
        polygons, discs = len(solids.names), len(solids.disc_names)
        self.own_base = polygons
        self.first_agent = polygons + 1 + discs
        self.first_cube = self.first_agent + len(agents)
        self.floor = self.first_cube + len(cubes)
        moving = (*(agent[0] for agent in agents), *(cube[0] for cube in cubes))
        self.names = (*solids.names, "base", *solids.disc_names, *moving, "floor")
        known = previous.prisms if previous is not None else {}
        keys = [(solids.polygon(i).tobytes(), *solids.z[i]) for i in range(polygons)]
        self.prisms = {key: known.get(key) or prism(solids.polygon(i), *solids.z[i]) for i, key in enumerate(keys)}
        self.shapes: list[coal.CollisionGeometry] = [*(self.prisms[key] for key in keys), base_shape]
        self.transforms = [coal.Transform3s() for _ in range(polygons + 1)]
        for (x, y, radius), (low, high) in zip(solids.discs, solids.disc_z, strict=True):
            self.shapes.append(coal.Cylinder(float(radius), float(high - low)))
            self.transforms.append(coal.Transform3s(np.eye(3), np.array([x, y, 0.5 * (low + high)])))
        self.shapes += [coal.Cylinder(radius, height) for _, radius, height in agents]
        self.shapes += [cube(side) for _, side in cubes]
        self.shapes.append(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0))
        self.transforms += [coal.Transform3s() for _ in range(len(self.shapes) - len(self.transforms))]
        unmapped = [i for i in range(polygons) if not solids.mapped[i]]
        self.unmapped_corners = np.vstack([np.zeros((0, 2)), *(solids.polygon(i) for i in unmapped)])
        counts = [len(solids.polygon(i)) for i in unmapped]
        self.unmapped_first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self.unmapped_discs = np.concatenate([solids.discs[~solids.disc_mapped], np.zeros((len(agents), 3))])

        self.corners = np.concatenate([solids.corners, np.zeros((4, 2))])
        self.first = np.append(solids.first, solids.first[-1] + 4)
        self.z = np.concatenate([solids.z, [[0.0, base_top]]])
        self.discs = np.concatenate([solids.discs, np.zeros((len(agents) + len(cubes), 3))])
        heights = np.array([(0.0, agent[2]) for agent in agents], dtype=float).reshape(-1, 2)
        self.disc_z = np.concatenate([solids.disc_z, heights, np.zeros((len(cubes), 2))])
        self.motion = np.zeros(len(self.names))
        self.cubes = np.zeros((len(cubes), 4))
        first = discs + len(agents)
        self._agent_discs, self._agent_motion = self.discs[discs:first], self.motion[self.first_agent : self.first_cube]
        self._cube_discs, self._cube_z = self.discs[first:], self.disc_z[first:]
        self._cube_motion = self.motion[self.first_cube : self.floor]
        self._cube_discs[:, 2] = [side * _ROOT_HALF for _, side in cubes]  # circumscribed, for any orientation
        self._sides = np.array([side for _, side in cubes])

    def move(
        self, pose: Array, foot: Footprint, base_motion: float, agents: tuple[Array, Array], cubes: tuple[Array, Array]
    ) -> None:
        """Update the places of base, agents and cubes, and store how far they moved [m].

        Agents and cubes: now and before, x, y, radius, height and x, y, z, yaw, shapes (n, 4).
        """
        place_base(self.corners, pose, foot.length, foot.width, foot.offset_x)
        self.motion[self.own_base] = base_motion
        if len(agents[0]):
            place_agents(self._agent_discs, self.unmapped_discs, self._agent_motion, *agents)
        self.cubes = cubes[0]
        if len(cubes[0]):
            place_cubes(self._cube_discs, self._cube_z, self._cube_motion, self._sides, *cubes)

    def settle(self, j: int, base: Array) -> None:
        """Move the shape of column j to its present place; ``base``: transform of the base body (4, 4)."""
        if j == self.own_base:
            self.transforms[j].setTransform(base[:3, :3], base[:3, 3])
        elif self.first_agent <= j < self.first_cube:
            k = j - self.own_base - 1
            self.transforms[j].setTranslation(np.array([self.discs[k, 0], self.discs[k, 1], 0.5 * self.disc_z[k, 1]]))
        elif self.first_cube <= j < self.floor:
            set_upright(self.transforms[j], self.cubes[j - self.first_cube].tolist())


def set_upright(transform: coal.Transform3s, pose: Sequence[float]) -> None:
    """Set a transform to x, y, z [m] and yaw [rad]."""
    transform.setTransform(about_z(pose[3]), np.array(pose[:3]))


def prism(corners: Array, low: float, high: float) -> coal.Convex:
    """A convex prism from its corners and faces, without a hull library, which may crash on flat prisms."""
    n = len(corners)
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for z in (low, high):
        for x, y in corners:
            points.append(np.array([x, y, z]))
    for i in range(1, n - 1):
        faces.append(coal.Triangle(0, i + 1, i))
        faces.append(coal.Triangle(n, n + i, n + i + 1))
    for i in range(n):
        j = (i + 1) % n
        faces.append(coal.Triangle(i, j, n + j))
        faces.append(coal.Triangle(i, n + j, n + i))
    return coal.Convex(points, faces)


@njit(cache=True)
def place_base(corners: Array, pose: Array, length: float, width: float, offset_x: float) -> None:
    """Write the rectangle of the base body [m] at a pose (3,) to the last four corners, counter-clockwise."""
    x, y = pose[0] + offset_x * math.cos(pose[2]), pose[1] + offset_x * math.sin(pose[2])
    put_rectangle(corners, corners.shape[0] - 4, x, y, pose[2], length, width)


@njit(cache=True)
def place_agents(discs: Array, unmapped: Array, motion: Array, agents: Array, before: Array) -> None:
    """Write agents [m], shape (n, 4), as discs, as the last n unmapped discs, and their motion [m], shape (n,)."""
    n = agents.shape[0]
    for i in range(n):
        for k in range(3):
            discs[i, k] = agents[i, k]
            unmapped[unmapped.shape[0] - n + i, k] = agents[i, k]
        dx, dy = agents[i, 0] - before[i, 0], agents[i, 1] - before[i, 1]
        motion[i] = math.sqrt(dx * dx + dy * dy)


@njit(cache=True)
def place_cubes(discs: Array, z: Array, motion: Array, sides: Array, cubes: Array, before: Array) -> None:
    """Write cubes (x, y, z [m], yaw; shape (n, 4)) as circumscribed upright cylinders, and their motion [m]."""
    for i in range(cubes.shape[0]):
        discs[i, 0], discs[i, 1] = cubes[i, 0], cubes[i, 1]
        z[i, 0], z[i, 1] = cubes[i, 2] - 0.5 * sides[i], cubes[i, 2] + 0.5 * sides[i]
        way = 0.0
        for k in range(3):
            way += (cubes[i, k] - before[i, k]) ** 2
        motion[i] = math.sqrt(way) + abs(cubes[i, 3] - before[i, 3]) * _ROOT_HALF * sides[i]


@njit(cache=True)
def update_gaps(
    gaps: Array,
    kind: NDArray[np.int64],
    limits: Array,
    now: Array,
    before: Array,
    centres: Array,
    radii: Array,
    corners: Array,
    first: Index,
    z: Array,
    discs: Array,
    disc_z: Array,
    motion: Array,
) -> Index:
    """Lower bounds of all distances [m] after one substep, in place, shape (shapes, columns).

    A bound shrinks by the largest possible motion of shape and column; where it falls below the pair's limit,
    ``limits[kind[i, j]]``, the distance of the shape's bounding sphere replaces it if that is larger. ``motion`` of the
    columns [m], transforms (shapes, 4, 4). Returns the pairs that are still below and must be measured, shape (k, 2).
    """
    polygons = first.shape[0] - 1
    below = []
    for i in range(gaps.shape[0]):
        c, moved2, turned2 = np.zeros(3), 0.0, 0.0
        for r in range(3):
            old = before[i, r, 3]
            c[r] = now[i, r, 3]
            for k in range(3):
                c[r] += now[i, r, k] * centres[i, k]
                old += before[i, r, k] * centres[i, k]
                turned2 += (now[i, r, k] - before[i, r, k]) ** 2
            moved2 += (c[r] - old) ** 2
        moved = math.sqrt(moved2) + radii[i] * _ROOT_HALF * math.sqrt(turned2)
        for j in range(gaps.shape[1]):
            gaps[i, j] -= moved + motion[j]
            if gaps[i, j] >= limits[kind[i, j]]:
                continue
            if j < polygons:
                flat = polygon_distance(c[0], c[1], corners, first[j], first[j + 1])
                high = max(0.0, z[j, 0] - c[2], c[2] - z[j, 1])
                bound = math.hypot(flat, high)
            elif j < polygons + discs.shape[0]:
                k = j - polygons
                flat = max(0.0, math.hypot(c[0] - discs[k, 0], c[1] - discs[k, 1]) - discs[k, 2])
                high = max(0.0, disc_z[k, 0] - c[2], c[2] - disc_z[k, 1])
                bound = math.hypot(flat, high)
            else:
                bound = c[2]
            gaps[i, j] = max(gaps[i, j], bound - radii[i])
            if gaps[i, j] < limits[kind[i, j]]:
                below.append((i, j))
    pairs = np.empty((len(below), 2), dtype=np.int64)
    for k in range(len(below)):
        pairs[k, 0], pairs[k, 1] = below[k]
    return pairs


_CHAIN = {f"panda_link{k}": k for k in range(8)} | {"panda_hand": 8, "panda_leftfinger": 9, "panda_rightfinger": 9}


def self_pairs(bodies: tuple[str, ...]) -> NDArray[np.int64]:
    """Pairs of shapes of the arm that are not neighbours, the one nearer to the hand first, shape (k, 2).

    Neighbours are joined by a joint. Hand, fingers and the held cube are one part; the base counts as part of the
    surroundings.
    """
    rank = [_CHAIN.get(body, -1) for body in bodies]
    pairs = []
    for i, body in enumerate(bodies):
        for k, other in enumerate(rank):
            if body == HELD:
                apart = 0 <= other <= _CHAIN["panda_link7"]
            else:
                apart = other >= 0 and rank[i] - other > 1 and other < _CHAIN["panda_hand"]
                apart = apart and not (other == _CHAIN["panda_link7"] and rank[i] > _CHAIN["panda_hand"])
            if apart:
                pairs.append((i, k))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


@njit(cache=True)
def update_self_gaps(
    gaps: Array,
    pairs: NDArray[np.int64],
    now: Array,
    before: Array,
    centres: Array,
    radii: Array,
) -> NDArray[np.int64]:
    """Lower bounds [m] of the distances of pairs after one substep, in place; the indices of those below 0.

    Motion is relative to the base, whose transform is the first of ``now`` and ``before``, shapes (n, 4, 4): driving
    alone does not change these distances.
    """
    n = now.shape[0]
    moved, middle = np.empty(n), np.empty((n, 3))
    for i in range(n):
        way2, turn2 = 0.0, 0.0
        for r in range(3):
            middle[i, r] = now[i, r, 3]
            for k in range(3):
                middle[i, r] += now[i, r, k] * centres[i, k]
        for r in range(3):
            own, old = 0.0, 0.0
            for k in range(3):
                point = before[i, k, 3]
                for m in range(3):
                    point += before[i, k, m] * centres[i, m]
                own += now[0, k, r] * (middle[i, k] - now[0, k, 3])
                old += before[0, k, r] * (point - before[0, k, 3])
            way2 += (own - old) ** 2
            for c in range(3):
                turn = 0.0
                for k in range(3):
                    turn += now[0, k, r] * now[i, k, c] - before[0, k, r] * before[i, k, c]
                turn2 += turn**2
        moved[i] = math.sqrt(way2) + radii[i] * _ROOT_HALF * math.sqrt(turn2)
    below = []
    for p in range(pairs.shape[0]):
        i, k = pairs[p, 0], pairs[p, 1]
        gaps[p] -= moved[i] + moved[k]
        if gaps[p] < 0.0:
            away = 0.0
            for r in range(3):
                away += (middle[i, r] - middle[k, r]) ** 2
            gaps[p] = max(gaps[p], math.sqrt(away) - radii[i] - radii[k])
            if gaps[p] < 0.0:
                below.append(p)
    found = np.empty(len(below), dtype=np.int64)
    for p in range(len(below)):
        found[p] = below[p]
    return found
