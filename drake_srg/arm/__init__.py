"""Arms: drivers, references, external torques, safety limits."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
