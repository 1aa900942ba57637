"""A suite of manipulation tasks for gymnasium and LeRobot (docs/lerobot.md)."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
