"""Planning: motions, grasps, the pick-and-place task, and scripts in its place."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
