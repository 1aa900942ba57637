"""Records runs as video, rosbag, log and timeline."""
