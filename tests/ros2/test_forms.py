"""CDR and type hashes against rosbags, which shares no code with them; keys and tokens of both forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from motm_twin.ros2 import forms as topics
from motm_twin.ros2.cdr import DEFINITIONS, NONE, SEQUENCE, CdrError, decode, encode, fields
from motm_twin.ros2.forms import BridgeForm, RmwForm, check_prefix, type_hash

STORES = {"humble": get_typestore(Stores.ROS2_HUMBLE), "jazzy": get_typestore(Stores.ROS2_JAZZY)}
NUMBERS = {
    "bool": st.booleans(),
    "int8": st.integers(-128, 127),
    "uint8": st.integers(0, 255),
    "int32": st.integers(-(2**31), 2**31 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "float32": st.floats(width=32, allow_nan=False),
    "float64": st.floats(allow_nan=False),
    "string": st.text(st.characters(exclude_characters="\x00", exclude_categories=("Cs",)), max_size=12),
}


def values(base):
    """Any value of a type."""
    if base not in DEFINITIONS:
        return NUMBERS[base]
    return st.fixed_dictionaries({field.name: _values(field) for field in fields(base)})


def _values(field):
    if field.count == NONE:
        return values(field.base)
    size = (0, 3) if field.count == SEQUENCE else (field.count, field.count)
    return st.lists(values(field.base), min_size=size[0], max_size=size[1])


def plain(message):
    """A message of rosbags as the dicts and lists of ours."""
    if hasattr(message, "__msgtype__"):
        return {field.name: plain(getattr(message, field.name)) for field in fields(message.__msgtype__)}
    if isinstance(message, np.ndarray):
        return message.tolist()
    return [plain(item) for item in message] if isinstance(message, list) else message


@pytest.mark.parametrize("store", STORES.values(), ids=STORES)
@pytest.mark.parametrize("message", DEFINITIONS)
@settings(max_examples=8, deadline=None)
@given(data=st.data())
def test_rosbags_reads_every_field_that_is_written(store, message, data):
    value = data.draw(values(message))
    written = encode(message, value)
    assert plain(store.deserialize_cdr(written, message)) == value
    assert decode(message, written) == value


@pytest.mark.parametrize("little", [True, False], ids=["little endian", "big endian"])
@pytest.mark.parametrize("message", DEFINITIONS)
@settings(max_examples=8, deadline=None)
@given(data=st.data())
def test_what_rosbags_writes_is_read_in_both_byte_orders(message, little, data):
    store = STORES["jazzy"]
    value = data.draw(values(message))
    made = store.deserialize_cdr(encode(message, value), message)
    assert decode(message, bytes(store.serialize_cdr(made, message, little_endian=little))) == value


@pytest.mark.parametrize("store", STORES.values(), ids=STORES)
@pytest.mark.parametrize("message", DEFINITIONS)
def test_fields_are_those_of_the_distribution(store, message):
    assert [field.name for field in fields(message)] == [name for name, _ in store.fielddefs[message][1]]


@pytest.mark.parametrize("message", DEFINITIONS)
def test_type_hashes_are_those_of_jazzy(message):
    assert type_hash(message) == STORES["jazzy"].hash_rihs01(message)


def test_the_hash_of_string_is_the_one_in_the_documentation_of_rmw_zenoh():
    published = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert type_hash("std_msgs/msg/String") == published


@settings(max_examples=400, deadline=None)
@given(message=st.sampled_from(sorted(DEFINITIONS)), data=st.binary(max_size=80))
def test_any_bytes_are_a_message_or_a_cdr_error(message, data):
    for head in (b"", b"\x00\x01\x00\x00"):
        try:
            decode(message, head + data)
        except CdrError:
            continue


@settings(max_examples=100, deadline=None)
@given(data=st.data(), message=st.sampled_from(sorted(DEFINITIONS)))
def test_a_message_that_was_cut_is_refused(data, message):
    written = encode(message, data.draw(values(message)))
    cut = data.draw(st.integers(0, len(written) - 1))
    with pytest.raises(CdrError):
        decode(message, written[:cut])


@pytest.mark.parametrize(
    ("message", "value"),
    [
        ("std_msgs/msg/String", {}),
        ("std_msgs/msg/String", {"data": 7}),
        ("std_msgs/msg/String", {"data": "a\x00b"}),
        ("builtin_interfaces/msg/Time", {"sec": 2**31, "nanosec": 0}),
        ("geometry_msgs/msg/PoseWithCovariance", {"pose": {}, "covariance": [0.0] * 36}),
        ("geometry_msgs/msg/TwistWithCovariance", {"twist": {}, "covariance": [0.0] * 35}),
    ],
)
def test_values_that_do_not_fit_are_refused(message, value):
    with pytest.raises(CdrError):
        encode(message, value)


def test_cells_that_are_no_bytes_are_refused():
    zero = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    info = {"map_load_time": {"sec": 0, "nanosec": 0}, "resolution": 0.05, "width": 2, "height": 1, "origin": zero}
    grid = {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "map"}, "info": info, "data": [100, -1]}
    assert encode("nav_msgs/msg/OccupancyGrid", grid)[-2:] == b"\x64\xff"
    with pytest.raises(CdrError, match="do not fit"):
        encode("nav_msgs/msg/OccupancyGrid", {**grid, "data": [100, 200]})


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
