"""Helpers for all higher packages: exceptions, ports, contacts, imperfect joints."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
