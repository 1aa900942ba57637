"""Settings and fixtures of all tests."""

import gc
import weakref

import pytest
from hypothesis import settings

from drake_srg.lifetime import LeafSystem

# No deadline: the machine may be busy. The same examples every time: a change that
# passes here passes elsewhere.
settings.register_profile("drake_srg", deadline=None, derandomize=True)
settings.load_profile("drake_srg")


@pytest.fixture
def leaked(monkeypatch):
    """Tells, when called, the Python systems made in the test that are still alive.

    A system written in Python lives as long as its diagram does. The wrapper of one
    that Drake made may go long before, so watching that shows nothing.
    """
    made = weakref.WeakSet()
    original = LeafSystem.__init__

    def register(self):
        original(self)
        made.add(self)

    def count():
        gc.collect()
        return sorted(type(system).__name__ for system in made)

    monkeypatch.setattr(LeafSystem, "__init__", register)
    count.made = made
    return count
