"""What ROS 2 programs want of the robot: written with rosbags, seen in the ticks of the twin."""

import math

import msgspec
import numpy as np
import pytest
from ear import JAZZY, until

from motm_twin.bus.commands import Answer, Drive, Pause, Play, Reset, Speed, Step
from motm_twin.ros2 import forms as topics
from motm_twin.ros2.bridge_process import Requests
from motm_twin.ros2.cdr import encode

FORMS = ("bridge", "rmw")


def made(topic, **values):
    """A message of rosbags as bytes."""
    return bytes(JAZZY.serialize_cdr(JAZZY.types[topic.message](**values), topic.message))


def twist(v, w):
    vector = JAZZY.types["geometry_msgs/msg/Vector3"]
    return made(topics.CMD_VEL, linear=vector(x=v, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=w))


def _parts(x, y, yaw, frame):
    kinds = JAZZY.types
    time = kinds["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    turn = kinds["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    place = kinds["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
    pose = kinds["geometry_msgs/msg/Pose"](position=place, orientation=turn)
    return kinds["std_msgs/msg/Header"](stamp=time, frame_id=frame), pose


def goal(x, y, yaw, frame="map"):
    header, pose = _parts(x, y, yaw, frame)
    return made(topics.GOAL_POSE, header=header, pose=pose)


def initial(x, y, yaw, frame="map"):
    header, pose = _parts(x, y, yaw, frame)
    covered = JAZZY.types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36))
    return made(topics.INITIAL_POSE, header=header, pose=covered)


@pytest.fixture(autouse=True)
def start(served):
    assert served.client.command(Speed(factor=1.0)).ok
    assert served.client.command(Reset(), timeout=20.0).ok
    until(lambda: served.tick.index < 200 and served.client.status().state in ("playing", "paused"), "no new run")
    assert served.client.command(Play(), timeout=20.0).ok
    served.refused.clear()


def refusal(served, words):
    return until(lambda: any(words in text for text in served.refused), f"not refused with {words!r}")


@pytest.mark.parametrize("form", FORMS)
def test_cmd_vel_drives_and_silence_gives_the_robot_back_to_its_task(served, form):
    def driven():
        served.publish(form, topics.CMD_VEL, twist(-0.15, 0.3))
        tick = served.tick
        return tick.plan.status == "by hand" and tick.robot.twist == pytest.approx([-0.15, 0.3], abs=0.02)

    until(driven, "it did not drive as cmd_vel says")
    assert "driven by hand" in served.tick.stop_reason
    until(lambda: served.tick.plan.status != "by hand", "it did not stop driving by hand")


class Waiting:
    """A client of a twin that waits for its first page."""

    def __init__(self, status):
        self._status, self.asked = msgspec.structs.replace(status, state="paused", held=True), []

    def status(self):
        return self._status

    def command(self, command, *_, **__):
        self.asked.append(command)
        return Answer(ok=True)


def test_cmd_vel_reaches_a_twin_that_waits_for_its_first_page(served):
    client, refused = Waiting(served.client.status()), []
    requests = Requests(client, lambda topic, text, unreadable: refused.append(text))
    requests.put(topics.CMD_VEL, twist(0.2, 0.1))
    until(lambda: client.asked or refused, "nothing came of it")
    requests.close()
    assert client.asked == [Drive(v=0.2, w=0.1)]


@pytest.mark.parametrize("form", FORMS)
def test_a_goal_is_driven_to_and_then_the_tasks_go_on(served, form):
    assert served.client.command(Speed(factor=4.0)).ok
    x, y, heading = served.client.scene().start
    there = (x - 0.4 * math.cos(heading), y - 0.4 * math.sin(heading))
    served.publish(form, topics.GOAL_POSE, goal(*there, heading))
    until(lambda: served.tick.tasks[served.tick.task_index].kind == "drive_to", "the goal is no task")
    task = until(lambda: [t for t in served.tick.tasks if t.kind == "drive_to" and t.status == "done"], "not reached")
    assert len(task) == 1
    picks = [t for t in served.tick.tasks if t.kind == "pick"]
    assert picks[0].status in ("active", "done")  # done: the tick that was seen came late


@pytest.mark.parametrize("form", FORMS)
def test_the_robot_is_put_where_it_is_said_to_be(served, form):
    assert served.client.command(Pause()).ok
    x, y, heading = served.client.scene().start
    served.publish(form, topics.INITIAL_POSE, initial(x - 0.3, y, heading + 0.5))
    until(lambda: served.client.status().recorded or served.tick.preview, "nothing was asked for")

    def put_there():  # step by step: played, it has driven on before a slow machine looks
        before = served.tick.index
        assert served.client.command(Step()).ok
        until(lambda: served.tick.index > before, "no step")
        return abs(served.tick.robot.true_pose[0] - (x - 0.3)) < 0.1

    until(put_there, "it was not put there")


def test_what_cannot_be_is_refused_with_a_sentence(served):
    """Of a pose that is too far only the bound of a push was said, and the page promised 5 m."""
    served.publish("bridge", topics.GOAL_POSE, goal(0.0, 0.0, 0.0, frame="odom"))
    refusal(served, "give it in 'map'")
    served.publish("bridge", topics.GOAL_POSE, goal(math.nan, 0.0, 0.0))
    refusal(served, "not finite")
    served.publish("bridge", topics.INITIAL_POSE, initial(500.0, 0.0, 0.0))
    refusal(served, "at most 0.5 m: push it there in several steps")
    x, y, heading = served.client.scene().start
    served.publish("bridge", topics.INITIAL_POSE, initial(x, y, heading + 2.0))
    refusal(served, "allowed is -1 to 1 rad: push it there in several steps")
    served.publish("bridge", topics.CMD_VEL, twist(math.inf, 0.0))
    refusal(served, "has to be finite")
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "map"}
    nowhere = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 0}}
    served.publish("bridge", topics.GOAL_POSE, encode(topics.GOAL_POSE.message, {"header": header, "pose": nowhere}))
    refusal(served, "no orientation")
    assert served.client.command(Pause()).ok
    until(lambda: served.client.status().state == "paused", "it did not pause")
    served.publish("bridge", topics.CMD_VEL, twist(0.1, 0.0))
    refusal(served, "only while time runs")
    assert served.client.status().recorded == 0


@pytest.mark.parametrize("form", FORMS)
def test_wrong_bytes_are_counted_and_change_nothing(served, form):
    bridge = served.bridges[form]
    wrong = [b"", b"\x00", b"\x00\x01\x00\x00", twist(0.1, 0.1)[:-1], twist(0.1, 0.1) + bytes(40), b"\xff" * 60,
             bytes(100_000)]  # fmt: skip
    for topic in topics.ACCEPTED:
        for payload in wrong:
            before = bridge.unreadable[topic.name]
            served.publish(form, topic, payload)
            until(lambda t=topic, b=before: bridge.unreadable[t.name] > b, f"{payload[:8]!r} was not counted")
    index, sent = served.tick.index, bridge.sent["tf"]
    until(lambda: served.tick.index > index and bridge.sent["tf"] > sent, "the bridge or the twin has stopped")
    assert served.client.status().recorded == 0


@pytest.mark.parametrize("form", FORMS)
def test_wrong_bytes_of_the_twin_are_counted_and_the_bridge_goes_on(served, form):
    bridge, keys = served.bridges[form], served.client.keys
    for key in (keys.robot, keys.scan):
        before = bridge.unreadable[key]
        for payload in (b"", b"{", b'{"version": "motm.robot/9"}', b"\xff\xfe"):
            served.say(key, payload)
        until(lambda k=key, b=before: bridge.unreadable[k] >= b + 4, "not counted")
    robot = served.client.robot() or until(served.client.robot, "no robot")
    odd = [{"pose": []}, {"odometry": [1.0]}, {"joint_names": ["a"] * 7}, {"q": [0.0]}, {"time": 1e300}]
    before = bridge.unreadable[keys.robot]
    for change in odd:
        served.say(keys.robot, msgspec.json.encode(msgspec.structs.replace(robot, **change)))
    until(lambda: bridge.unreadable[keys.robot] >= before + len(odd), "not counted")
    sent = bridge.sent["tf"]
    until(lambda: bridge.sent["tf"] > sent, "the bridge has stopped")
