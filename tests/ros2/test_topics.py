"""Every topic of both forms, read with rosbags and compared with what the twin itself says for the same instant."""

import math
import struct

import numpy as np
import pinocchio
import pytest
import zenoh.ext
from ear import HUMBLE, JAZZY, Ear, at, direct, until
from scipy.spatial.transform import Rotation

from motm_twin.bus.commands import AddObstacle, RemoveBody
from motm_twin.ros2 import forms as topics
from motm_twin.ros2.cdr import decode
from motm_twin.ros2.convert import DELETE
from motm_twin.ros2.forms import PUBLISHED

LATCHED = [topic for topic in PUBLISHED if topic.latched]
TOO_RARE = {topics.TF_STATIC, topics.ROBOT_DESCRIPTION}  # for who comes later


@pytest.fixture(scope="module", params=["bridge", "rmw"])
def ear(served, request):
    with Ear(served, request.param) as listener:
        yield listener


def matched(ear, topic, count, kept, stamp):
    """Pairs of a ROS 2 message and the twin's own of the same time, from the newest ``count`` messages."""

    def pairs():
        return [(message, kept[at(stamp(message))]) for message in ear.wait(topic, count) if at(stamp(message)) in kept]

    return until(pairs, "no instant is in both")


def of_header(message):
    return message.header.stamp


@pytest.mark.parametrize("topic", [topic for topic in PUBLISHED if topic not in TOO_RARE], ids=lambda topic: topic.name)
def test_every_topic_comes_and_is_read_by_both_distributions(ear, topic):
    ear.wait(topic)
    payload = ear.heard[topic][-1]
    assert payload[:4] == b"\x00\x01\x00\x00"
    for store in (JAZZY, HUMBLE):
        message = store.deserialize_cdr(payload, topic.message)
        assert bytes(store.serialize_cdr(message, topic.message)) == payload
    assert decode(topic.message, payload)


def test_joints_are_those_of_the_robot_at_that_time(ear):
    for message, robot in matched(ear, topics.JOINT_STATES, 20, ear.robot, of_header):
        half = 0.5 * robot.gripper_width
        assert message.name == [*robot.joint_names, "panda_finger_joint1", "panda_finger_joint2"]
        assert message.position.tolist() == [*robot.q, half, half]
        assert message.velocity.tolist() == [*robot.dq, 0.0, 0.0]
        assert message.effort.size == 0


def test_odometry_is_that_of_the_wheels(ear):
    for message, robot in matched(ear, topics.ODOM, 20, ear.robot, of_header):
        place, twist = message.pose.pose.position, message.twist.twist
        q = message.pose.pose.orientation
        assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
        assert [place.x, place.y, place.z] == [*robot.odometry[:2], 0.0]
        assert 2.0 * math.atan2(q.z, q.w) == pytest.approx(robot.odometry[2])
        assert [twist.linear.x, twist.linear.y, twist.angular.z] == [robot.twist[0], 0.0, robot.twist[1]]
        for covariance in (message.pose.covariance, message.twist.covariance):
            matrix = covariance.reshape(6, 6)
            assert (np.diag(matrix) > 0.0).all()
            assert np.array_equal(matrix, np.diag(np.diag(matrix)))


def test_the_clock_follows_the_robot(ear):
    times = [at(message.clock) for message in ear.wait(topics.CLOCK, 30)]
    assert times == sorted(times)
    assert set(times) & set(ear.robot)


def test_transforms_make_one_tree_that_has_every_frame_where_the_twin_has_it(served, ear):
    static = latest(served, ear.form, topics.TF_STATIC).transforms
    for message, robot in matched(ear, topics.TF, 20, ear.robot, lambda m: m.transforms[0].header.stamp):
        tree = {item.child_frame_id: item for item in (*static, *message.transforms)}
        assert len(tree) == len(static) + len(message.transforms), "a frame has two parents"
        assert {*robot.frames, "odom"} <= set(tree)
        for name, (x, y, z, w, i, j, k) in robot.frames.items():
            place, turn = on_map(tree, name)
            assert place == pytest.approx((x, y, z), abs=2e-5)
            assert abs(np.dot(turn, (i, j, k, w))) == pytest.approx(1.0, abs=1e-6)


def on_map(tree, name):
    """Place and quaternion (x, y, z, w) of a frame, by walking to the root of the tree."""
    place, turn = np.zeros(3), Rotation.identity()
    while name != "map":
        item = tree[name]
        t, r = item.transform.translation, item.transform.rotation
        step = Rotation.from_quat([r.x, r.y, r.z, r.w])
        place, turn = np.array([t.x, t.y, t.z]) + step.apply(place), step * turn
        name = item.header.frame_id
    return place, turn.as_quat()


def test_a_sweep_has_its_beams_and_infinity_for_none(served, ear):
    lidar = served.client.scene().robot.lidar
    for message, scan in matched(ear, topics.SCAN, 10, ear.scan, of_header):
        assert message.header.frame_id == "lidar"
        assert message.ranges.size == len(scan.ranges) == lidar.beams
        wanted = np.array([math.inf if value is None else value for value in scan.ranges], dtype=np.float32)
        assert np.array_equal(message.ranges, wanted)
        assert message.angle_min + 720 * message.angle_increment == pytest.approx(message.angle_max, abs=1e-4)
        assert message.angle_min == pytest.approx(scan.angle_min)
        assert (message.range_min, message.range_max) == pytest.approx((scan.range_min, scan.range_max))
        assert message.scan_time == pytest.approx(1.0 / lidar.rate)
        assert message.intensities.size == 0


def test_the_map_is_the_grid_of_the_twin(ear):
    for message, (info, cells) in matched(ear, topics.MAP, 2, ear.grids, of_header):
        data = np.frombuffer(cells, dtype=np.uint8)
        assert (message.info.width, message.info.height) == (info["width"], info["height"])
        assert message.info.resolution == pytest.approx(info["resolution"])
        assert [message.info.origin.position.x, message.info.origin.position.y] == info["origin"]
        assert np.array_equal(message.data == 100, data == 255)
        assert message.data.min() == 0
        free = data < 255
        assert np.abs(message.data[free] / 99.0 - data[free] / 254.0).max() < 0.02


def test_plans_are_those_of_the_tick(ear):
    for message, tick in matched(ear, topics.PLAN, 10, ear.ticks, of_header):
        assert [[p.pose.position.x, p.pose.position.y] for p in message.poses] == tick.plan.global_path
    for message, tick in matched(ear, topics.LOCAL_PLAN, 10, ear.ticks, of_header):
        assert message.header.frame_id == "map"
        assert [[p.pose.position.x, p.pose.position.y] for p in message.poses] == [
            pose[:2] for pose in tick.plan.local_poses
        ]
        times = [at(pose.header.stamp) - tick.time for pose in message.poses]
        assert times == pytest.approx(tick.plan.local_times, abs=1e-5)


def test_markers_show_candidates_by_cost_and_every_body_where_it_is(served, ear):
    pairs = matched(ear, topics.MARKERS, 10, ear.ticks, lambda m: m.markers[0].header.stamp)
    for message, tick in pairs:
        found = {(marker.ns, marker.id): marker for marker in message.markers}
        assert len(found) == len(message.markers), "a marker is there twice"
        if tick.placement.poses:
            dots = found["candidates", 0]
            assert [[p.x, p.y] for p in dots.points] == [pose[:2] for pose in tick.placement.poses]
            grey = [colour.a < 0.5 for colour in dots.colors]
            assert grey == [cost is None for cost in tick.placement.cost]
        objects = [marker for marker in message.markers if marker.ns == "objects"]
        assert [[m.pose.position.x, m.pose.position.y, m.pose.position.z] for m in objects] == [
            body.position for body in tick.objects
        ]
        assert len({marker.ns for marker in message.markers} & {"furniture", "bins", "goal"}) == 3
    numbers = [{(m.ns, m.id) for m in message.markers if m.ns == "objects"} for message, _ in pairs]
    assert all(now == numbers[0] for now in numbers)


def test_the_marker_of_what_was_removed_is_deleted(served, ear):
    before = served.client.command(AddObstacle(name="box", x=1.0, y=-1.5))
    assert before.ok, before.reason

    def marker(action):
        messages = [JAZZY.deserialize_cdr(p, topics.MARKERS.message) for p in ear.heard[topics.MARKERS][-40:]]
        hits = [m for message in messages for m in message.markers if m.ns == "obstacles" and m.action == action]
        return hits[-1] if hits else None

    shown = until(lambda: marker(0), "the box was not drawn")
    assert (shown.scale.x, shown.scale.y, shown.scale.z) == (0.5, 0.5, 0.6)
    assert shown.pose.position.z == 0.3
    assert served.client.command(RemoveBody(name="box")).ok
    assert until(lambda: marker(DELETE), "the box was not deleted").id == shown.id


def latest(served, form, topic):
    """What somebody who subscribes only now gets at once."""
    got = []
    subscriber = zenoh.ext.declare_advanced_subscriber(
        served.session,
        form.key(topic),
        direct(lambda sample: got.append(sample.payload.to_bytes())),
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
    )
    try:
        until(lambda: got, f"{topic.name} did not come")
    finally:
        subscriber.undeclare()
    return JAZZY.deserialize_cdr(got[0], topic.message)


@pytest.mark.parametrize("topic", LATCHED, ids=lambda topic: topic.name)
def test_late_joiners_get_what_is_latched(served, ear, topic):
    message = latest(served, ear.form, topic)
    assert getattr(message, next(iter(message.__dataclass_fields__)))


@pytest.mark.parametrize("topic", LATCHED, ids=lambda topic: topic.name)
def test_the_cache_of_what_is_latched_can_be_asked(served, ear, topic):
    key = ear.form.key(topic)

    def asked():
        replies = [reply.ok for reply in served.session.get(f"{key}/@adv/**?_anyke", timeout=2.0)]
        return [sample for sample in replies if sample is not None and str(sample.key_expr) == key]

    assert decode(topic.message, until(asked, "the cache did not answer")[0].payload.to_bytes())
    assert [reply.ok for reply in served.session.get(key, timeout=1.0) if reply.ok is not None] == []


def test_the_robot_description_is_a_robot(served, ear):
    urdf = latest(served, ear.form, topics.ROBOT_DESCRIPTION).data
    model = pinocchio.buildModelFromXML(urdf)
    assert {"base_link", "panda_tcp", "camera", "lidar"} <= {frame.name for frame in model.frames}
    assert "package://" not in urdf


def test_every_endpoint_is_announced(served, ear):
    own = ear.form.own_tokens()[0]
    pattern = "@ros2_lv/7/**" if own.startswith("@ros2_lv") else f"{own}/**"
    tokens = {str(reply.ok.key_expr) for reply in served.session.liveliness().get(pattern) if reply.ok}
    wanted = {ear.form.token(topic, "MP", number) for number, topic in enumerate(PUBLISHED)}
    wanted |= {ear.form.token(topic, "MS", number) for number, topic in enumerate(topics.ACCEPTED, len(PUBLISHED))}
    assert wanted <= tokens


def test_rmw_messages_carry_number_time_and_sender(ear):
    ear.wait(topics.TF)
    attached = ear.attached[topics.TF]
    if ear.form.attachment("t", 1, 2) is None:
        assert attached is None
        return
    sequence, nanoseconds, length = struct.unpack("<qqB", attached[:17])
    assert (sequence > 0, nanoseconds > 1.7e18, length, len(attached)) == (True, True, 16, 33)
