"""Fixtures of the servo's tests."""

import contextlib

import pytest

from robot.serve.dynamixel.fake_station import FakeStation, connect


@pytest.fixture
def station():
    with FakeStation("tcp:0") as station:
        yield station


@pytest.fixture
def line(station):
    """A function that opens a new connection."""
    with contextlib.ExitStack() as stack:
        yield lambda: stack.enter_context(connect(station.bridge))
