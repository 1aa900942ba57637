"""Fixtures for the tests of sweeps."""

import pytest

from drake_srg.sweeps import sweep

from . import stub


@pytest.fixture
def unchecked(monkeypatch):
    """Skip building the cell, which takes a second; tests of the command do it."""
    monkeypatch.setattr(sweep, "check_scenario", stub.unchecked)
