"""Folders of shipped assets and scenes, and meshes by name: for drawing, for ghosts, and for collisions.

The folders are beside the package in a checkout, and inside it when it is installed from a wheel.
"""

import functools
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.model.profile import RobotProfile

_PACKAGE = Path(__file__).resolve().parent.parent


def _shipped(name: str) -> Path:
    for folder in (_PACKAGE / name, _PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"{name}/ is neither in {_PACKAGE} nor beside it: reinstall motm_twin")


def web_assets_dir() -> Path:
    """Folder of URDF, meshes and licences."""
    return _shipped("web_assets")


def scenes_dir() -> Path:
    """Folder of the shipped scenes."""
    return _shipped("scenes")


def robot_urdf(profile: RobotProfile) -> ET.Element:
    """``frankie.urdf`` with the profile's mount of the arm, and its footprint as base body."""
    robot = ET.parse(web_assets_dir() / "frankie.urdf").getroot()  # noqa: S314 - our own file, not from outside
    mount = robot.find("joint[@name='arm_mount']/origin")
    body = robot.find("link[@name='base_link']/collision/origin")
    box = robot.find("link[@name='base_link']/collision/geometry/box")
    if mount is None or body is None or box is None:
        raise ValueError("frankie.urdf lacks the joint arm_mount or the collision box of base_link: restore the file")
    arm, foot = profile.arm, profile.footprint
    mount.set("xyz", f"{arm.mount_x!r} {arm.mount_y!r} {arm.mount_z!r}")
    body.set("xyz", f"{foot.offset_x!r} 0.0 {0.5 * foot.height!r}")
    box.set("size", f"{foot.length!r} {foot.width!r} {foot.height!r}")
    return robot


LINKS = (
    "base_link",
    *(f"panda_link{i}" for i in range(8)),
    "panda_hand",
    "panda_leftfinger",
    "panda_rightfinger",
)  # all links with a shape, in the order of `Frankie.link_transforms`

Faces = NDArray[np.uint32]

_SHAPED = {link: "base" if link == "base_link" else link.removeprefix("panda_") for link in LINKS}
PROPS = ("temi", "person", "cube", "bin")  # things of a scene, origin on the floor (temi) or at the centre (cube)

VISUAL = {**{link: f"visual/{name}.glb" for link, name in _SHAPED.items()}, **{n: f"visual/{n}.glb" for n in PROPS}}
GHOST = {link: f"ghost/{name}.glb" for link, name in _SHAPED.items()}
COLLISION = {f"panda_{name}": f"collision/{name}.stl" for name in (*(f"link{i}" for i in range(8)), "hand")}

_FINGER_BOXES = (  # in the left finger's frame: centre x, y, z and size x, y, z [m]; the URDF has the same boxes
    ((0.0, 0.0146, 0.0150), (0.0220, 0.0236, 0.0300)),
    ((0.0, 0.0084, 0.0420), (0.0210, 0.0168, 0.0240)),
)


def asset_path(table: dict[str, str], name: str) -> Path:
    """File of an asset from `VISUAL`, `GHOST` or `COLLISION`; raises KeyError that names the known ones."""
    if name not in table:
        raise KeyError(f"no asset {name!r}: choose one of {', '.join(table)}")
    return web_assets_dir() / table[name]


@functools.cache
def glb_bytes(name: str) -> bytes:
    """The GLB file of a link or prop for viewers; cached."""
    return asset_path(VISUAL, name).read_bytes()


@functools.cache
def ghost_mesh(link: str) -> tuple[Array, Faces]:
    """Vertices [m] (n, 3) and faces (m, 3) of a link's light mesh in its own frame, for batched drawing; read-only."""
    return _shape(asset_path(GHOST, link))


@functools.cache
def collision_hull(link: str) -> tuple[Array, Faces]:
    """Vertices [m] (n, 3) and faces (m, 3) of a link's convex hull in its own frame; read-only.

    Only links of the arm and the hand: the base is the profile's footprint, fingers are `finger_boxes`.
    """
    return _shape(asset_path(COLLISION, link))


def finger_boxes(link: str) -> tuple[tuple[Array, Array], ...]:
    """Boxes of a finger in its own frame: centre [m] (3,) and full size [m] (3,) each."""
    sides = {"panda_leftfinger": 1.0, "panda_rightfinger": -1.0}
    if link not in sides:
        raise KeyError(f"no finger {link!r}: choose one of {', '.join(sides)}")
    mirror = np.array([1.0, sides[link], 1.0])
    return tuple((np.array(centre) * mirror, np.array(size)) for centre, size in _FINGER_BOXES)


def _shape(path: Path) -> tuple[Array, Faces]:
    import trimesh

    mesh = trimesh.load(path, force="mesh")
    if not isinstance(mesh, trimesh.Trimesh) or mesh.is_empty:
        raise ValueError(f"{path.name} holds no mesh: make it again with tools/make_assets.py")
    vertices, faces = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.uint32)
    vertices.setflags(write=False)
    faces.setflags(write=False)
    return vertices, faces
