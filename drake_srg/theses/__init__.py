"""Methods of the two theses, to compare with."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
