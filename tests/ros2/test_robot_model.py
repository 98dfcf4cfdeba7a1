"""The URDF for ROS 2 programs: read by pinocchio and yourdfpy, and the transforms against pinocchio's."""

import xml.etree.ElementTree as ET
from pathlib import Path
from urllib.parse import unquote, urlparse

import msgspec
import numpy as np
import pinocchio
import pytest
import yourdfpy
from scipy.spatial.transform import Rotation

from motm_twin.model.profile import ArmSpec, Lidar, RobotProfile
from motm_twin.ros2.robot_model import FILES, PRIMITIVES, RobotModel


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
