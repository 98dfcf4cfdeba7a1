"""Doubts (warnings) about a scene that can run, but probably not as its author meant: printed, not refused."""

import itertools
import math
from collections.abc import Iterable, Iterator

from motm_twin.model.assets import finger_boxes
from motm_twin.model.names import SceneError, hint
from motm_twin.model.scene import Pick, Place, Scene, SceneObject
from motm_twin.model.scene_check import (
    TOUCH,
    check_cube_cover,
    check_out_of_bins,
    check_rest,
    cube_outline,
    object_node,
)
from motm_twin.model.scene_file import Document, with_variant
from motm_twin.model.scene_format import COLOURS
from motm_twin.model.scene_resolve import Resolver
from motm_twin.model.scene_shapes import REST, bin_solid, covers, outline, rectangle
from motm_twin.model.scene_yaml import Node, show

LOW_FLOOR = 0.2  # [m] a bin with a lower floor stands on the room's floor: baskets have feet and thick bottoms
_TIP = finger_boxes("panda_leftfinger")[1][1]  # [m] fingertip: across, from the pad outwards, along it
BESIDE = 0.027  # [m] needed beside a face: fingertip, and half of the 19 mm by which the gripper opens wider
LIKELY_SWAPPED = 2.0  # distance in its standard deviations, below which cubes may be confused
_NAMED = 3  # variants that a doubt names at most


def doubts(document: Document) -> tuple[SceneError, ...]:
    """Doubts about a document that `check_document` accepts, sorted by file and line.

    The same doubt about several variants is one; it names them unless it is about all, or its place names them.
    """
    variants = document.variants()
    found: dict[str, tuple[SceneError, list[str]]] = {}
    for variant in variants or [None]:
        root, chosen = with_variant(document, variant)
        for doubt in about_scene(Resolver(root, None).scene(document.name, chosen), root):
            found.setdefault(str(doubt), (doubt, []))[1].append(chosen)
    named = [_naming(doubt, among if len(among) < len(variants) else []) for doubt, among in found.values()]
    return tuple(sorted([*named, *about_slots(document)], key=lambda doubt: (doubt.file, doubt.line or 0)))


def variant_doubts(document: Document, variant: str | None, seed: int | None) -> tuple[SceneError, ...]:
    """Doubts about one variant as `load_scene` loads it, with these arguments."""
    root, chosen = with_variant(document, variant)
    return tuple(about_scene(Resolver(root, seed).scene(document.name, chosen), root))


def _naming(doubt: SceneError, variants: list[str]) -> SceneError:
    if not variants or doubt.place.startswith(tuple(f"variants.{name}." for name in variants)):
        return doubt
    names = ", ".join(f"'{name}'" for name in variants[:_NAMED]) + (", ..." if len(variants) > _NAMED else "")
    problem = f"{doubt.problem} (in the variant{'s' if len(variants) > 1 else ''} {names})"
    return SceneError(problem, file=doubt.file, line=doubt.line, place=doubt.place)


def about_scene(scene: Scene, root: Node) -> Iterator[SceneError]:
    """Doubts about one variant of a scene."""
    yield from about_support(scene, root)
    yield from about_filling(scene, root)
    yield from about_colours(root)
    yield from about_fingers(scene, root)
    yield from about_look_alikes(scene, root)


def about_support(scene: Scene, root: Node) -> Iterator[SceneError]:
    """Bins that float: nothing under their centre supports them."""
    for item in scene.bins:
        under = [s for s in scene.solids if s.z_max <= item.floor_z + TOUCH and covers(s.shape, item.centre)]
        highest = max(under, key=lambda solid: solid.z_max, default=None)
        if item.floor_z <= (LOW_FLOOR if highest is None else max(LOW_FLOOR, highest.z_max + REST)):
            continue
        below = "the floor" if highest is None else f"'{highest.name}', {highest.z_max:g} m high"
        yield root.at("bins", item.name).error(
            f"it floats: its floor_z is {item.floor_z:g} m, and under its middle is {below}: move it over its stand, "
            "or lower floor_z and rim_z"
        )


def about_filling(scene: Scene, root: Node) -> Iterator[SceneError]:
    """Bins whose cubes have more volume than the bin up to its rim."""
    sides = {item.name: item.side for item in scene.objects}
    held, volumes = "", {item.name: 0.0 for item in scene.bins}
    for task in scene.tasks:
        if isinstance(task, Pick):
            held = task.object
        elif isinstance(task, Place):
            volumes[task.bin] += sides[held] ** 3
    for item in scene.bins:
        room = (item.side - 2.0 * item.wall) ** 2 * (item.rim_z - item.floor_z)
        if volumes[item.name] > room:
            yield root.at("bins", item.name).error(
                f"{1e3 * volumes[item.name]:.2g} litres of cubes go into it, up to its rim it holds {1e3 * room:.2g}: "
                "make it larger, or put less into it"
            )


def about_colours(root: Node) -> Iterator[SceneError]:
    """Unknown names of colours."""
    objects, deliver = root.value.get("objects"), root.value.get("deliver")
    for owner in [*(objects.value.values() if objects else ()), *([deliver] if deliver else ())]:
        node = owner.value.get("colour")
        if node is not None and not node.value.startswith("#") and node.value not in COLOURS:
            yield node.error(f"{show(node.value)} is no known colour, and drawn red; {hint(node.value, COLOURS)}")


def about_fingers(scene: Scene, root: Node) -> Iterator[SceneError]:
    """Cubes without room for the fingers beside either pair of faces when they are picked."""
    there = {item.name: item for item in scene.objects}
    for task in scene.tasks:
        if not isinstance(task, Pick):
            continue
        item = there.pop(task.object)
        beside = min(BESIDE, 0.5 * (scene.robot.gripper.max_width - item.side) + float(_TIP[1]))
        pairs = _beside_faces(scene, item, there.values(), beside)
        if all(pairs):
            names = " and ".join(f"'{name}'" for name in dict.fromkeys(pairs))
            yield (
                object_node(root, item.name)
                .at("at")
                .error(
                    f"no room for the fingers, which need {1e3 * beside:.0f} mm beside two opposite faces: {names} "
                    f"{'are' if ' and ' in names else 'is'} in the way; move one of them"
                )
            )


def about_look_alikes(scene: Scene, root: Node) -> Iterator[SceneError]:
    """Cubes without markers for different bins, too close to tell apart given the uncertainty of their places."""
    apart = LIKELY_SWAPPED * math.sqrt(2.0) * scene.noise.slot_error_until_seen
    if scene.detections == "named":
        return
    held, goal = "", {}
    for task in scene.tasks:
        held = task.object if isinstance(task, Pick) else held
        if isinstance(task, Place):
            goal.setdefault(held, task.bin)
    there = [item for item in scene.objects if item.name in goal]
    for one, other in itertools.combinations(there, 2):
        away = math.dist(one.position, other.position)
        if goal[one.name] != goal[other.name] and away < apart:
            yield (
                object_node(root, other.name)
                .at("at")
                .error(
                    f"it may be taken for '{one.name}', {1e3 * away:.0f} mm away, which goes into another bin: where "
                    f"they stand is known to {1e3 * scene.noise.slot_error_until_seen:.0f} mm; put them farther apart, "
                    "or give them markers (detections: named)"
                )
            )


def _beside_faces(scene: Scene, item: SceneObject, others: Iterable[SceneObject], beside: float) -> list[str]:
    """Per pair of faces: name of a body within ``beside`` [m] at the height of the cube's centre, or ""."""
    x, y, z = item.position
    solids = [*scene.solids, *map(bin_solid, scene.bins)]
    bodies = [(s.name, outline(s.shape), s.z_min, s.z_max) for s in solids]
    bodies += [(o.name, cube_outline(o), o.position[2] - o.side / 2, o.position[2] + o.side / 2) for o in others]
    level = [(name, shape) for name, shape, low, high in bodies if low < z + item.side / 2 - TOUCH and high > z + TOUCH]
    pairs = []
    for turn in (0.0, 0.5 * math.pi):
        fingers = [
            rectangle((x, y, item.yaw + turn + half), (beside - TOUCH, float(_TIP[0])), 0.5 * (item.side + beside))
            for half in (0.0, math.pi)
        ]
        pairs.append(next((name for name, shape in level if any(map(shape.intersects, fingers))), ""))
    return pairs


def about_slots(document: Document) -> list[SceneError]:
    """Slots that cannot hold a cube in any variant: not on their surface, in a bin, or under something."""
    good, wrong = set(), {}
    for variant in document.variants() or [None]:
        root, chosen = with_variant(document, variant)
        resolver = Resolver(root, None)
        scene = resolver.scene(document.name, chosen)
        for name in resolver.slots:
            node = root.at("slots", name)
            definition = (node.file, node.line, node.place)
            try:
                _check_slot(scene, resolver.cube_on(name), node)
                good.add(definition)
            except SceneError as error:
                wrong.setdefault(definition, error)
    return [error for definition, error in wrong.items() if definition not in good]


def _check_slot(scene: Scene, item: SceneObject, node: Node) -> None:
    """Raise SceneError unless a cube on a slot rests on its surface, in no bin, and under nothing."""
    check_rest(scene, item, node)
    check_out_of_bins(scene, item, node)
    if scene.robot.has_arm:
        check_cube_cover(scene, item, node)


__all__ = [
    "about_colours",
    "about_filling",
    "about_fingers",
    "about_look_alikes",
    "about_scene",
    "about_slots",
    "about_support",
    "doubts",
    "variant_doubts",
]
