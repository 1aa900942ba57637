"""Recorders: video, rosbag, log and timeline."""
