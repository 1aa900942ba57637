"""Replays: a run's scene as animated glTF, and a page that plays it in any browser."""

from drake_srg.replay.compare import write_comparison
from drake_srg.replay.page import write_page
from drake_srg.replay.recorder import ReplayRecorder
from drake_srg.replay.rrd import write_rrd

__all__ = ["ReplayRecorder", "write_comparison", "write_page", "write_rrd"]
