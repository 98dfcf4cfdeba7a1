"""The shipped meshes, hulls and capsules fit each other and the URDF."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
import trimesh

from motm_twin.model import arm_kernels, assets
from motm_twin.model.arm_kernels import ARM_FRAMES, fk_arm
from motm_twin.model.assets import LINKS, web_assets_dir
from motm_twin.model.profile import READY

FINGER_Z = 0.0584
WIDTH_HALVES = (0.0, 0.02, 0.04)


def drawn(name: str) -> trimesh.Trimesh:
    """Mesh of a link or prop as it is drawn."""
    return trimesh.load(assets.asset_path(assets.VISUAL, name), force="mesh")


def distance_to_capsules(points: np.ndarray, rows: list[int]) -> np.ndarray:
    """Signed distance of points (n, 3) to the union of some capsules, in their frame."""
    best = np.full(len(points), np.inf)
    for i in rows:
        p0, axis = arm_kernels.CAPSULE_P0[i], arm_kernels.CAPSULE_P1[i] - arm_kernels.CAPSULE_P0[i]
        along = np.clip((points - p0) @ axis / (axis @ axis), 0.0, 1.0)
        distance = np.linalg.norm(points - p0 - along[:, None] * axis, axis=1) - arm_kernels.CAPSULE_RADII[i]
        best = np.minimum(best, distance)
    return best


def samples_inside(vertices: np.ndarray, count: int = 4000) -> np.ndarray:
    """Random convex combinations of corners, most of them near the surface, and the corners."""
    rng = np.random.default_rng([11, 2])
    weights = rng.dirichlet(np.full(4, 0.6), size=count)
    mixed = np.einsum("nk,nkd->nd", weights, vertices[rng.integers(len(vertices), size=(count, 4))])
    return np.vstack([vertices, mixed])


@pytest.mark.parametrize("link", [link for link in assets.COLLISION if link != "panda_link0"])
def test_control_capsules_contain_the_hull_that_the_referee_judges(link: str) -> None:
    rows = [i for i, name in enumerate(arm_kernels.CAPSULE_LINKS) if name == link]
    vertices, _ = assets.collision_hull(link)
    assert distance_to_capsules(samples_inside(vertices), rows).max() <= 1e-6


@pytest.mark.parametrize("link", ["panda_leftfinger", "panda_rightfinger"])
def test_finger_capsules_contain_the_finger_at_every_width(link: str) -> None:
    rows = [i for i, name in enumerate(arm_kernels.CAPSULE_LINKS) if name == link]
    side = 1.0 if link == "panda_leftfinger" else -1.0
    corners = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, -1).T
    for half_width in WIDTH_HALVES:
        for centre, size in assets.finger_boxes(link):
            points = samples_inside(corners * size + centre) + np.array([0.0, side * half_width, FINGER_Z])
            assert distance_to_capsules(points, rows).max() <= 1e-6


def test_capsules_are_not_much_fatter_than_the_arm() -> None:
    for link in assets.COLLISION:
        rows = [i for i, name in enumerate(arm_kernels.CAPSULE_LINKS) if name == link]
        for i in rows:
            vertices, _ = assets.collision_hull(link)
            p0, p1 = arm_kernels.CAPSULE_P0[i], arm_kernels.CAPSULE_P1[i]
            low = np.minimum(p0, p1) - arm_kernels.CAPSULE_RADII[i]
            high = np.maximum(p0, p1) + arm_kernels.CAPSULE_RADII[i]
            assert np.all(low > vertices.min(axis=0) - 0.04)
            assert np.all(high < vertices.max(axis=0) + 0.04)


def test_capsule_segments_are_the_table_moved_with_its_links() -> None:
    T = fk_arm(READY)
    segments = arm_kernels.capsule_segments(T)
    for i, frame in enumerate(arm_kernels.CAPSULE_FRAMES):
        for end, point in enumerate((arm_kernels.CAPSULE_P0[i], arm_kernels.CAPSULE_P1[i])):
            np.testing.assert_allclose(segments[i, end], T[frame, :3, :3] @ point + T[frame, :3, 3], atol=1e-12)
    assert {ARM_FRAMES[frame] for frame in arm_kernels.CAPSULE_FRAMES} == {
        *(f"panda_link{i}" for i in range(1, 8)),
        "panda_hand",
    }


@pytest.mark.parametrize("link", list(assets.COLLISION))
def test_collision_hulls_are_convex_closed_and_small(link: str) -> None:
    vertices, faces = assets.collision_hull(link)
    assert 4 <= len(faces) <= 400
    centre = vertices.mean(axis=0)
    corners = vertices[faces.astype(int)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    outward = np.sign(np.einsum("fd,fd->f", normals, corners[:, 0] - centre))
    heights = np.einsum("fd,fvd->fv", normals * outward[:, None], vertices[None] - corners[:, :1])
    assert heights.max() < 1e-4
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2)


def test_urdf_fingers_have_the_boxes_that_the_referee_uses() -> None:
    robot = ET.parse(web_assets_dir() / "frankie.urdf").getroot()  # noqa: S314 - our own file
    for link in ("panda_leftfinger", "panda_rightfinger"):
        shapes = robot.findall(f"link[@name='{link}']/collision")
        for shape, (centre, size) in zip(shapes, assets.finger_boxes(link), strict=True):
            origin, box = shape.find("origin"), shape.find("geometry/box")
            assert origin is not None
            assert box is not None
            np.testing.assert_allclose([float(v) for v in origin.get("xyz", "").split()], centre)
            np.testing.assert_allclose([float(v) for v in box.get("size", "").split()], size)


def test_every_mesh_that_the_urdf_names_is_shipped() -> None:
    robot = ET.parse(web_assets_dir() / "frankie.urdf").getroot()  # noqa: S314 - our own file
    names = [mesh.get("filename", "") for mesh in robot.iter("mesh")]
    assert len(names) == len(LINKS) + len(assets.COLLISION)
    for name in names:
        assert (web_assets_dir() / name.removeprefix("package://web_assets/")).is_file(), name


@pytest.mark.parametrize("link", [*assets.COLLISION, "panda_leftfinger", "panda_rightfinger"])
def test_drawn_link_and_ghost_lie_within_the_solid_link(link: str) -> None:
    if link in assets.COLLISION:
        solid, _ = assets.collision_hull(link)
    else:
        boxes = assets.finger_boxes(link)
        solid = np.vstack([[centre - size / 2, centre + size / 2] for centre, size in boxes])
    for vertices in (drawn(link).vertices, assets.ghost_mesh(link)[0]):
        assert np.all(vertices.min(axis=0) > solid.min(axis=0) - 0.007)
        assert np.all(vertices.max(axis=0) < solid.max(axis=0) + 0.007)


def test_drawn_base_fills_its_footprint() -> None:
    low, high = drawn("base_link").bounds
    np.testing.assert_allclose(low, [-0.35, -0.25, 0.0], atol=0.01)
    np.testing.assert_allclose(high[:2], [0.35, 0.25], atol=0.01)
    assert 0.37 < high[2] <= 0.40


def test_drawn_temi_is_one_metre_tall_and_a_quarter_metre_round() -> None:
    vertices = drawn("temi").vertices
    assert vertices[:, 2].min() == pytest.approx(0.0, abs=1e-3)
    assert vertices[:, 2].max() == pytest.approx(1.0, abs=0.05)
    assert 0.2 < np.linalg.norm(vertices[:, :2], axis=1).max() <= 0.251


def test_meshes_are_light_enough_for_a_browser() -> None:
    files = {folder: list((web_assets_dir() / folder).glob("*.glb")) for folder in ("visual", "ghost")}
    assert sum(file.stat().st_size for file in files["visual"]) < 3_500_000
    assert sum(file.stat().st_size for file in files["ghost"]) < 500_000
    assert len(drawn("base_link").faces) < 60_000


def test_licence_and_notice_stand_beside_the_converted_meshes() -> None:
    folder = web_assets_dir() / "LICENSES"
    assert "Apache License" in (folder / "Apache-2.0.txt").read_text()
    notice = (folder / "NOTICE.md").read_text()
    assert "decimated" in notice
    assert "Franka" in notice


def test_an_unknown_asset_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(KeyError, match="panda_hand"):
        assets.glb_bytes("gripper")
