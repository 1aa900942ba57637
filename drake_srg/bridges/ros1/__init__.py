"""ROS 1: a node on the wire, without ROS installed."""
