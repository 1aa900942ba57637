"""Scenarios: the schema, loader and checks of scenario files."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
