"""ROS 2 over Zenoh: the twin as standard messages, in the form of zenoh-bridge-ros2dds or of rmw_zenoh."""
