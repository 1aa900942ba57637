"""Replays: a run's scene as animated glTF, and a page that plays it in any browser."""

from drake_srg.recording.replay.page import write_comparison, write_page
from drake_srg.recording.replay.recorder import ReplayRecorder

__all__ = ["ReplayRecorder", "write_comparison", "write_page"]
