"""ROS 2: a participant on DDS, without ROS installed."""
