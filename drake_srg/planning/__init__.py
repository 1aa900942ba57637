"""Planning: motions, grasps, and the planners of all tasks."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
