"""The topics of the bridge: name, type, and how many messages a late joiner may still get."""

from typing import NamedTuple


class Topic(NamedTuple):
    """One topic. All are reliable, which every subscriber accepts; latched ones are transient local."""

    name: str
    message: str
    depth: int = 10
    latched: bool = False


JOINT_STATES = Topic("joint_states", "sensor_msgs/msg/JointState")
ODOM = Topic("odom", "nav_msgs/msg/Odometry")
TF = Topic("tf", "tf2_msgs/msg/TFMessage", depth=100)
TF_STATIC = Topic("tf_static", "tf2_msgs/msg/TFMessage", depth=1, latched=True)
SCAN = Topic("scan", "sensor_msgs/msg/LaserScan")
MAP = Topic("map", "nav_msgs/msg/OccupancyGrid", depth=1, latched=True)
PLAN = Topic("plan", "nav_msgs/msg/Path")
LOCAL_PLAN = Topic("local_plan", "nav_msgs/msg/Path")
MARKERS = Topic("markers", "visualization_msgs/msg/MarkerArray")
ROBOT_DESCRIPTION = Topic("robot_description", "std_msgs/msg/String", depth=1, latched=True)
CLOCK = Topic("clock", "rosgraph_msgs/msg/Clock", depth=1)
PUBLISHED = (
    JOINT_STATES, ODOM, TF, TF_STATIC, SCAN, MAP, PLAN, LOCAL_PLAN, MARKERS, ROBOT_DESCRIPTION, CLOCK,
)  # fmt: skip

CMD_VEL = Topic("cmd_vel", "geometry_msgs/msg/Twist", depth=1)
GOAL_POSE = Topic("goal_pose", "geometry_msgs/msg/PoseStamped", depth=1)
INITIAL_POSE = Topic("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", depth=1)
ACCEPTED = (CMD_VEL, GOAL_POSE, INITIAL_POSE)
