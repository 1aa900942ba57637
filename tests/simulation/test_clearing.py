"""Judging runs that clear a table, from made-up logs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform

from drake_srg.cell.clearing import bin_box
from drake_srg.scenario import load_scenario
from drake_srg.simulation.clearing import clearing_outcome
from drake_srg.simulation.log_format import MODES, pose_to_row
from drake_srg.types import Failure, Left, Mode, PlannerStatus

IN_BIN, ON_TABLE = [0.3, -0.55, 0.05], [0.6, 0.1, 0.025]
A, B = "clutter_1", "clutter_2"


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("clear_table", overrides=["clutter.count=2"])


def log(scenario, ends, modes):
    """Return the log of a run in which objects rest where they are at the end."""
    rows = len(modes)
    home = [*scenario.arm.home, *[0.0] * 7]
    poses = {n: pose_to_row(RigidTransform(np.array(p))) for n, p in ends.items()}
    return {
        "time": 0.05 * np.arange(rows),
        "mode": np.array([MODES.index(mode) for mode in modes], dtype=float),
        "arm.state_measured": np.tile(home, (rows, 1)),
        **{f"object_pose.{n}": np.tile(row, (rows, 1)) for n, row in poses.items()},
    }


MODES_OF_A_PICK = [Mode.IDLE, Mode.GRASP, Mode.CLOSE, Mode.CLOSE, Mode.DONE]


def outcome(scenario, ends, **status):
    made = log(scenario, ends, MODES_OF_A_PICK)
    return clearing_outcome(scenario, made, PlannerStatus(mode=Mode.DONE, **status))


def test_bin_of_the_scenario(scenario):
    low, high = bin_box(scenario)
    np.testing.assert_allclose(low, [0.04, -0.76, 0.0], atol=1e-9)
    np.testing.assert_allclose(high, [0.64, -0.36, 0.12], atol=1e-9)


def test_counts_what_is_in_the_bin(scenario):
    found = outcome(scenario, {A: IN_BIN, B: IN_BIN}, attempts=3, cycles=2)
    assert found.metrics()["objects_cleared"] == 2
    assert found.metrics()["picks_held"] == 2
    assert found.picks_per_hour == pytest.approx(36000.0)  # two in 0.2 s
    assert found.honest


@settings(max_examples=20)  # each measures the objects anew
@given(st.floats(-np.pi, np.pi), st.floats(0.0, 0.2))
def test_what_lies_beside_the_bin_is_not_in_it(scenario, direction, far):
    low, high = bin_box(scenario)
    # From the middle through its side, and a little or a lot further.
    x, y = np.cos(direction), np.sin(direction)
    half = 0.5 * (high - low)[:2]
    reach = 0.001 + far + min(half[0] / max(abs(x), 1e-9), half[1] / max(abs(y), 1e-9))
    beside = [*(0.5 * (low + high)[:2] + reach * np.array([x, y])), 0.05]
    found = outcome(scenario, {A: IN_BIN, B: beside})
    assert (found.objects[A].cleared, found.objects[B].cleared) == (True, False)


def test_what_is_left_needs_a_reason(scenario):
    ends = {A: IN_BIN, B: ON_TABLE}
    assert not outcome(scenario, ends).honest
    elsewhere = Left(np.array([0.9, 0.1, 0.05]), Failure.TOO_WIDE)
    assert not outcome(scenario, ends, left=(elsewhere,)).honest
    there = Left(np.array([0.6, 0.1, 0.05]), Failure.TOO_WIDE)
    found = outcome(scenario, ends, left=(elsewhere, there))
    assert found.honest
    assert found.objects[B].outcome == "too_wide"


def test_a_claim_too_many_is_not_honest(scenario):
    assert not outcome(scenario, {A: IN_BIN, B: IN_BIN}, cycles=3).honest


def test_a_grasp_counts_for_the_nearest_object(scenario):
    found = outcome(scenario, {A: IN_BIN, B: ON_TABLE})
    assert sum(thing.attempts for thing in found.objects.values()) == 1
    assert found.objects[A].attempts == 1  # home is over the bin
