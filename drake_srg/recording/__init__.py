"""Recordings of runs: video, rosbag, log, timeline and replay."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
