"""Settings and fixtures shared by all tests."""

import gc
import os
import signal
import sys
import weakref
from pathlib import Path

# One thread per process, before NumPy loads its BLAS: the test workers share the cores,
# and BLAS's threads, which wait in a loop, cost most on small matrices. Processes that
# tests start inherit it.
os.environ.update(LP_NUM_THREADS="0", OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import pytest
from hypothesis import settings

from drake_srg.lifetime import LeafSystem

# In the background of a shell, or under `nohup`, they are ignored, and so they would be
# by the processes that tests start.
for number, handler in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)

# Makes `experiments` importable, and the packages in tools/, such as `make_site`. At
# the end, so that `models` stays tests/models.
ROOT = Path(__file__).parents[1]
sys.path += map(str, (ROOT, ROOT / "tools", ROOT / "tests/experiments"))
pytest_plugins = ["fake_experiment"]

# No deadline, because the machine may be busy. The same examples every time, so that a
# change that passes here passes elsewhere; half of Hypothesis's default number, which
# keeps the suite short.
settings.register_profile("drake_srg", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("drake_srg")


# The files that take longest, first: the workers then end together.
LONGEST = (
    "sweeps/test_engines.py",
    "test_notebooks.py",
    "test_lessons.py",
    "simulation/test_recorders.py",
    "scenarios/test_assistive_arm.py",
    "scenarios/test_clear_table_together.py",
    "suite/test_env.py",
    "scenarios/test_thesis_kitchen.py",
    "suite/test_envs.py",
    "test_state_in_context.py",
    "simulation/test_simulate.py",
    "scenarios/test_carry_together.py",
    "models/test_every_model.py",
    "scenarios/test_insert.py",
    "robot/serve/test_examples.py",
    "station/test_video_process.py",
    "robot/drive/test_run.py",
    "cli/test_commands.py",
    "scenarios/test_handover.py",
    "examples/test_own_diagram.py",
    "simulation/test_benchmark.py",
    "experiments/test_run.py",
    "scenarios/test_own_cell.py",
    "experiments/test_rerun.py",
    "robot/identify/test_fits.py",
    "planning/pick_and_place/test_own_modes.py",
    "experiments/test_pages.py",
    "scenarios/test_varied_cells.py",
    "robot/serve/test_loop.py",
    "planning/clearing/test_sharing.py",
)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Leave the hundreds of thousands of objects that tests consist of to no collector.

    They stay to the end, and `leaked` below would look at all of them every time.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items):
    ranks = {Path(__file__).parent / name: i for i, name in enumerate(LONGEST)}
    items.sort(key=lambda item: ranks.get(item.path, len(ranks)))


def pytest_runtest_setup(item):
    if item.get_closest_marker("learn"):
        pytest.importorskip("torch", reason="the extra `learn`: make test-learn")
    if item.get_closest_marker("lerobot"):
        pytest.importorskip("lerobot", reason="the extra `lerobot`: make test-lerobot")


@pytest.fixture
def leaked(monkeypatch):
    """Return a function that lists the test's Python systems that are still alive.

    A system written in Python lives as long as its diagram. Python's wrapper of a C++
    system may go long before the diagram does, so watching that one proves nothing.
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
