"""Helpers for every package above: exceptions, ports, contacts, imperfect joints."""
