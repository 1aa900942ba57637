"""Vision: camera models, localizer, height maps and obstacles."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
