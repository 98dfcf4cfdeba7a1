"""The URDF, read by pinocchio and yourdfpy; markers of scenes with polygons, moved furniture and things gone."""

import xml.etree.ElementTree as ET
from pathlib import Path
from urllib.parse import unquote, urlparse

import msgspec
import numpy as np
import pinocchio
import pytest
import yourdfpy
from ear import JAZZY
from scipy.spatial.transform import Rotation

from motm_twin.bus.encode import tick_message
from motm_twin.model.edits import MoveBody, RemoveBody
from motm_twin.model.profile import ArmSpec, Lidar, RobotProfile
from motm_twin.model.scene import Prism
from motm_twin.model.scene_file import load_scene
from motm_twin.model.scene_shapes import pieces, stands_on
from motm_twin.ros2.cdr import encode
from motm_twin.ros2.convert import DELETE, TRIANGLE_LIST, Markers
from motm_twin.ros2.forms import MARKERS
from motm_twin.ros2.robot_model import FILES, PRIMITIVES, RobotModel
from motm_twin.twin import Twin


@pytest.fixture(scope="module")
def twin():
    return Twin(load_scene("playground", None, None))


def drawn(markers, tick):
    """Markers as rosbags reads them, by namespace and number."""
    message = JAZZY.deserialize_cdr(encode(MARKERS.message, markers.array(tick_message(tick, 1, 0.0))), MARKERS.message)
    return {(marker.ns, marker.id): marker for marker in message.markers}


def test_every_solid_and_bin_of_a_scene_is_drawn(twin):
    twin.reset()
    markers = Markers()
    markers.show(twin.scene)
    found = drawn(markers, twin.advance())
    assert sum(ns == "furniture" for ns, _ in found) == len(twin.scene.solids)
    assert sum(ns == "bins" for ns, _ in found) == len(twin.scene.bins)
    assert sum(ns == "agents" for ns, _ in found) == len(twin.scene.agents)
    prisms = [solid for solid in twin.scene.solids if isinstance(solid.shape, Prism)]
    shapes = [marker for marker in found.values() if marker.type == TRIANGLE_LIST]
    assert len(shapes) == len(prisms) > 0
    for marker, solid in zip(shapes, prisms, strict=True):
        corners = len(solid.shape.corners)
        assert len(marker.points) == 3 * (2 * corners + corners - 2)  # two for each side, and the top
        assert {point.z for point in marker.points} == {solid.z_min, solid.z_max}


def empty(scene, piece):
    cubes = [stands_on(scene, piece, item.position[:2], item.position[2] - 0.5 * item.side) for item in scene.objects]
    return not piece.bins and not any(cubes)


def test_moved_furniture_keeps_its_number_and_what_is_gone_is_deleted_once(twin):
    twin.reset()
    markers = Markers()
    markers.show(twin.scene)
    before = drawn(markers, twin.advance())
    piece = next(piece for piece in pieces(twin.scene).values() if empty(twin.scene, piece))
    x, y = piece.centre
    twin.post(MoveBody(name=piece.name, x=x + 0.1, y=y, held=False))
    moved = drawn(markers, twin.advance())
    assert set(moved) == set(before)
    shifts = {round(moved[k].pose.position.x - before[k].pose.position.x, 3) for k in before if k[0] == "furniture"}
    assert shifts == {0.0, 0.1}
    twin.post(RemoveBody(name=piece.name))
    after = drawn(markers, twin.advance())
    gone = [key for key, marker in after.items() if marker.action == DELETE]
    assert len(gone) == len(piece.solids)
    again = drawn(markers, twin.advance())
    assert not [marker for marker in again.values() if marker.action == DELETE]
    assert set(again) == set(before) - set(gone)


def test_a_candidate_that_was_rejected_is_grey_and_cheap_is_brighter_than_dear(twin):
    twin.reset()
    markers = Markers()
    tick = twin.advance()
    dots = drawn(markers, tick)["candidates", 0]
    cost = tick.placement.cost.tolist()
    viable = [i for i, why in enumerate(tick.placement.rejected) if not why]
    cheap, dear = min(viable, key=cost.__getitem__), max(viable, key=cost.__getitem__)
    brightness = [colour.r + colour.g + colour.b for colour in dots.colors]
    assert brightness[cheap] > brightness[dear]
    assert all((dots.colors[i].a < 0.5) == (i not in viable) for i in range(len(cost)))


def parsed(urdf):
    return ET.fromstring(urdf)  # noqa: S314 - our own


OTHER = msgspec.structs.replace(RobotProfile(), arm=ArmSpec(mount_x=0.2, mount_z=0.5), lidar=Lidar(x=0.3, z=0.25))


@pytest.mark.parametrize("profile", [RobotProfile(), OTHER], ids=["Frankie", "other mount"])
def test_transforms_are_those_of_the_urdf(profile):
    robot = RobotModel(profile)
    model = pinocchio.buildModelFromXML(robot.urdf)
    names = [name for name in model.names if name != "universe"]
    q = np.random.default_rng(1).uniform(0.0, 0.04, len(names))
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    tree = {item.child: item for item in (*robot.static(), *robot.moving(dict(zip(names, q, strict=True))))}
    for frame in ("lidar", "camera", "panda_tcp", "panda_leftfinger", "panda_rightfinger", "panda_link8"):
        place, turn, at = np.zeros(3), Rotation.identity(), frame
        while at != "base_link":
            step = Rotation.from_quat(tree[at].rotation)
            place, turn = np.array(tree[at].translation) + step.apply(place), step * turn
            at = tree[at].parent
        wanted = data.oMf[model.getFrameId(frame)]
        assert place == pytest.approx(wanted.translation, abs=1e-9)
        assert turn.as_matrix() == pytest.approx(wanted.rotation, abs=1e-9)


def test_boxes_need_no_files(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(RobotModel(RobotProfile(), PRIMITIVES).urdf)
    robot = yourdfpy.URDF.load(str(file), load_collision_meshes=True)
    links = set(robot.link_map)
    drawn = {name for name, link in robot.link_map.items() if link.visuals}
    assert {"base_link", "lidar", "camera", "panda_tcp"} <= links
    assert {"base_link", "panda_hand", "panda_leftfinger", *(f"panda_link{i}" for i in range(8))} <= drawn
    assert "mesh" not in file.read_text()
    assert robot.scene.extents[2] > 1.0


def test_meshes_are_files_that_are_there():
    root = parsed(RobotModel(RobotProfile(), FILES).urdf)
    meshes = [mesh.get("filename") for mesh in root.findall("link/visual/geometry/mesh")]
    assert len(meshes) == 9  # seven links, their foot, and the hand
    assert all(mesh.startswith("file:///") and Path(unquote(urlparse(mesh).path)).is_file() for mesh in meshes)


def test_meshes_can_come_from_a_web_server():
    urdf = RobotModel(RobotProfile(), "http://robot.lab:8000/").urdf
    assert 'filename="http://robot.lab:8000/collision/link0.stl"' in urdf


def test_the_body_has_the_size_of_the_profile():
    profile = msgspec.structs.replace(
        RobotProfile(), footprint=msgspec.structs.replace(RobotProfile().footprint, length=0.9, offset_x=0.1)
    )
    box = parsed(RobotModel(profile, PRIMITIVES).urdf).find("link[@name='base_link']/visual")
    assert box.find("geometry/box").get("size") == "0.9 0.5 0.38"
    assert box.find("origin").get("xyz") == "0.1 0.0 0.19"


def test_a_robot_without_an_arm_is_a_base_with_a_lidar():
    robot = RobotModel(msgspec.structs.replace(RobotProfile(), has_arm=False))
    root = parsed(robot.urdf)
    assert [link.get("name") for link in root.findall("link")] == ["base_link", "lidar"]
    assert [item.child for item in robot.static()] == ["lidar"]
    assert robot.moving_joints == () and robot.moving({}) == []
