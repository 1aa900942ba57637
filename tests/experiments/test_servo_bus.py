import math

import pytest

from drake_srg.experiments import servo_bus
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.servo_bus import WIRES, run

PLACED = {"claimed": 1, "placed": 1, "reason": "", "error": 0.4e-3, "rounding": 0.5e-3}
STOPPED = {
    "claimed": 0,
    "placed": 0,
    "reason": "stale",
    "error": 0.3,
    "rounding": math.nan,
}
WRONG = {"claimed": 1, "placed": 0, "reason": "", "error": 3e-3, "rounding": 0.5e-3}


def judged(monkeypatch, **changes):
    """Which rows pass for each wire, where some trials differ: {wire: trial}."""
    monkeypatch.setattr(
        servo_bus, "_trial", lambda name, seed: changes.get(name, PLACED)
    )
    result = run(quiet, seeds=2, fault_seeds=1)
    return {name: [r.passed for r in result.rows if r.name == name] for name in WIRES}


def test_every_wire_passes_that_places_as_well_as_none(monkeypatch):
    assert all(all(passed) for passed in judged(monkeypatch).values())


@pytest.mark.parametrize(
    ("name", "trial", "failing"),
    [
        ("Protocol 1.0", WRONG, [0, 1, 2, 3]),
        ("Protocol 1.0", STOPPED, [2, 3]),
        ("Protocol 2.0", {**PLACED, "error": 1.4e-3}, [2]),
        ("servo reboots", STOPPED, []),
        ("servo reboots", {**STOPPED, "reason": ""}, [1]),
    ],
)
def test_what_is_wrong_fails(monkeypatch, name, trial, failing):
    passed = judged(monkeypatch, **{name: trial})[name]
    assert [k for k, good in enumerate(passed) if not good] == failing
