"""Methods of the two theses, for comparison."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
