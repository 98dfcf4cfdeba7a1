"""The rmw_zenoh form against zenoh-ros2-sdk, a ROS 2 node in Python that shares no code with the bridge.

The SDK would fetch message definitions from GitHub; here it finds them in a folder, written by rosbags. It finds the
publishers of latched topics only in the root namespace (it does not mangle slashes inside names).
"""

import pytest
from ear import JAZZY, until

from motm_twin.bus.private_folder import own_credentials
from motm_twin.ros2 import forms as topics
from motm_twin.ros2.cdr import DEFINITIONS
from motm_twin.ros2.forms import PUBLISHED, type_hash

sdk = pytest.importorskip("zenoh_ros2_sdk", reason="zenoh-ros2-sdk is not installed", exc_type=ImportError)
from zenoh_ros2_sdk import discovery  # noqa: E402
from zenoh_ros2_sdk.message_registry import get_registry  # noqa: E402
from zenoh_ros2_sdk.qos import QosDurability, QosProfile  # noqa: E402
from zenoh_ros2_sdk.session import ZenohSession  # noqa: E402


@pytest.fixture(scope="module")
def node(served, tmp_path_factory):
    """How the SDK is told where the twin is; its one session is closed at the end."""
    folder = tmp_path_factory.mktemp("messages")
    for message in DEFINITIONS:
        package, kind, name = message.split("/")
        file = folder / package / kind / f"{name}.msg"
        file.parent.mkdir(parents=True, exist_ok=True)
        text, _ = JAZZY.generate_msgdef(message, ros_version=2)
        file.write_text(text.split("=" * 80)[0])
    with pytest.MonkeyPatch.context() as patch:
        user, password = own_credentials()
        known = f'transport/auth/usrpwd/user="{user}";transport/auth/usrpwd/password="{password}"'
        patch.setenv("ZENOH_CONFIG_OVERRIDE", f'mode="client";{known}')
        patch.setattr(get_registry(), "messages_dir", folder)
        ip, port = "127.0.0.1", served.server.port
        session = ZenohSession.get_instance(ip, port)
        yield {"router_ip": ip, "router_port": port, "domain_id": 7}
        session.close()


@pytest.mark.parametrize("topic", PUBLISHED, ids=lambda topic: topic.name)
def test_a_node_reads_every_topic_and_computes_the_same_type_hash(node, topic):
    got = []
    durability = QosDurability.TRANSIENT_LOCAL if topic.latched else QosDurability.VOLATILE
    subscriber = sdk.ROS2Subscriber(
        f"/{topic.name}", topic.message, got.append, qos=QosProfile(durability=durability, history_depth=1), **node
    )
    try:
        until(lambda: got, f"{topic.name} never came")
    finally:
        subscriber.close()
    assert subscriber.type_hash == type_hash(topic.message)
    assert got[0].__msgtype__ == topic.message


def test_a_node_drives_the_robot_with_cmd_vel(served, node):
    publisher = sdk.ROS2Publisher(f"/{topics.CMD_VEL.name}", topics.CMD_VEL.message, **node)
    vector = JAZZY.types["geometry_msgs/msg/Vector3"]

    def driven():
        publisher.publish(linear=vector(x=-0.1, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.4))
        return served.tick.plan.status == "by hand" and served.tick.robot.twist == pytest.approx([-0.1, 0.4], abs=0.02)

    try:
        until(driven, "cmd_vel of the SDK did not drive the robot")
    finally:
        publisher.close()
    until(lambda: served.tick.plan.status != "by hand", "it did not stop")


def test_the_graph_lists_the_topics_with_their_types_and_qos(node):
    listed = dict(discovery.get_topic_names_and_types(**node))
    for topic in PUBLISHED:
        assert listed[f"/{topic.name}"] == [topic.message]
    info = discovery.get_topic_info("/map", verbose=True, **node)
    latched = QosProfile.decode(info.publishers[0].qos)
    assert (info.publishers[0].node_name, latched.durability) == ("motm_twin", QosDurability.TRANSIENT_LOCAL)
