"""Replays: the scene of a run as animated glTF, and a web page that plays it."""

from drake_srg.recording.replay.page import write_comparison, write_page
from drake_srg.recording.replay.recorder import ReplayRecorder

__all__ = ["ReplayRecorder", "write_comparison", "write_page"]
