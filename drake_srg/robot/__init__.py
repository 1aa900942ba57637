"""Everything about a real robot: serve a simulation as one, drive one, follow one."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
