"""Export of a scenario's models as URDF, SDF or MJCF, for other simulators."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
