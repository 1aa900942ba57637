"""Scenarios: the schema of scenario files, and how to load one."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
