"""ROS 2: a DDS participant, without ROS installed."""
