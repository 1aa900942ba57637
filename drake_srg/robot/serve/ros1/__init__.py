"""ROS 1: a node that speaks the wire protocol, without ROS installed."""
