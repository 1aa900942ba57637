import dataclasses as dc

import pytest

from drake_srg.common.safety_states import StopReason
from drake_srg.experiments import safety
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.safety import Case, Stop, judge

GOOD = Stop(
    Case("jump", 0),
    StopReason.SPEED,
    share=0.5,
    reaction=0.0,
    commanded=0.05,
    measured=0.15,
    bound=0.2,
    effort=0.5,
    distance=0.02,
    off_path=0.01,
    limits=(0.9, 1.0),
    drift=0.0,
)


class Arm:
    period = 0.005


@pytest.mark.parametrize(
    ("change", "quantity"),
    [
        ({}, None),
        ({"reason": StopReason.NONE}, "stopped otherwise, or not"),
        ({"reaction": -0.1}, "stopped otherwise, or not"),
        ({"limits": (1.1, 1.0)}, "speed / limit"),
        ({"limits": (0.9, 1.1)}, "deceleration / limit"),
        ({"drift": 1e-6}, "motion once stopped"),
        ({"reaction": 0.01}, "reaction, longest"),
        ({"commanded": 0.21}, "commands at rest, latest"),
        ({"measured": 0.21}, "arm at rest / its bound"),
        ({"measured": 0.21, "effort": 0.98}, "arm at rest / its bound"),
    ],
)
def test_a_worse_stop_fails(change, quantity):
    rows = judge([GOOD, dc.replace(GOOD, **change)], Arm())
    assert [row.quantity for row in rows if not row.passed] == [quantity][: len(change)]


def test_a_motor_at_its_limit_is_told_apart():
    full = dc.replace(GOOD, measured=0.21, effort=1.0)
    rows = {row.quantity: row for row in judge([GOOD, full], Arm())}
    assert rows["arm at rest / its bound"].measured == pytest.approx(0.75)
    assert rows["the same, motor at its limit"].measured == pytest.approx(1.05)
    assert all(row.passed for row in rows.values())


@pytest.mark.slow
def test_faults_stop_the_arm(monkeypatch):
    monkeypatch.setattr(safety, "FAULTS", {"jump": StopReason.SPEED})
    result = safety.run(quiet, faults=1)
    assert all(row.passed for row in result.rows), result.table()
    assert result.tables["stops"]["reason"] == ["speed"]
