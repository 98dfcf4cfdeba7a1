"""Keys, tokens and attachments of both forms, as their documentations show them."""

import pytest

from motm_twin.ros2 import forms as topics
from motm_twin.ros2.forms import BridgeForm, RmwForm, check_prefix, type_hash

TF = type_hash("tf2_msgs/msg/TFMessage")


def test_keys_and_tokens_of_rmw_zenoh():
    form = RmwForm("8b20", node="twin", domain=7, prefix="/lab/one")
    assert form.key(topics.TF) == f"7/lab/one/tf/tf2_msgs::msg::dds_::TFMessage_/{TF}"
    assert form.own_tokens() == ["@ros2_lv/7/8b20/0/0/NN/%/%lab%one/twin"]
    assert form.token(topics.TF, "MP", 2) == (
        f"@ros2_lv/7/8b20/0/3/MP/%/%lab%one/twin/%lab%one%tf/tf2_msgs::msg::dds_::TFMessage_/{TF}/::,100:,:,:,,"
    )


def test_the_root_namespace_and_latched_topics_of_rmw_zenoh():
    form = RmwForm("8b20", node="twin")
    assert form.own_tokens() == ["@ros2_lv/0/8b20/0/0/NN/%/%/twin"]
    assert form.token(topics.TF_STATIC, "MP", 3).endswith(
        f"/MP/%/%/twin/%tf_static/{form.key(topics.TF_STATIC)[12:]}/:1:,1:,:,:,,"
    )


def test_humble_has_no_hashes():
    assert RmwForm("8b20", node="twin", distro="humble").key(topics.TF).endswith("/TypeHashNotSupported")
    assert BridgeForm("8b20", distro="humble").token(topics.TF, "MP", 0).endswith("§TFMessage/:1:0:0,100")


def test_keys_and_tokens_of_the_bridge():
    form = BridgeForm("8b20", prefix="/lab/")
    assert BridgeForm("8b20").key(topics.TF) == "tf"
    assert form.key(topics.TF) == "lab/tf"
    assert form.own_tokens() == ["@/8b20/@ros2_lv"]
    assert form.token(topics.MAP, "MP", 0) == (
        "@/8b20/@ros2_lv/MP/lab§map/nav_msgs§msg§OccupancyGrid/:1:1:0,1:typehash="
        f"{type_hash('nav_msgs/msg/OccupancyGrid')};"
    )
    assert form.attachment("token", 1, 2) is None


def test_the_attachment_has_number_time_and_an_id_of_its_own():
    form = RmwForm("8b20", node="twin")
    one, other = form.attachment("a", 5, 7), form.attachment("b", 5, 7)
    assert one[:17] == (5).to_bytes(8, "little") + (7).to_bytes(8, "little") + b"\x10"
    assert len(one) == 33
    assert one[17:] != other[17:]


@pytest.mark.parametrize("prefix", ["/", "/a", "/a/b_1/"])
def test_a_namespace_is_taken(prefix):
    assert check_prefix(prefix) == prefix.rstrip("/")


@pytest.mark.parametrize("prefix", ["", "a", "//", "/1", "/a b", "/a//b", "/a-b", "/*", "/a\n"])
def test_what_is_no_namespace_is_refused(prefix):
    with pytest.raises(ValueError, match="prefix"):
        check_prefix(prefix)


def test_domain_and_distribution_are_checked():
    with pytest.raises(ValueError, match="0 to 232"):
        RmwForm("8b20", node="twin", domain=233)
    with pytest.raises(ValueError, match="humble, jazzy"):
        BridgeForm("8b20", distro="iron")
