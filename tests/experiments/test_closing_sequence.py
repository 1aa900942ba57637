import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import closing_sequence
from drake_srg.experiments.closing_sequence import (
    DRIVERS,
    ClosingSequence,
    close,
    judge,
    judge_agreement,
)
from drake_srg.experiments.registry import quiet

TIME = np.arange(0.0, 2.0, 0.002)


def ramp(start, speed, end):
    return np.clip(speed * (TIME - start), 0.0, end)


def made_up(base_arrives=1.0, tip_starts=1.0, **changes):
    """A sequence in which the bases close, touch the can and stop; then the tips do."""
    base = np.stack(2 * [np.clip(TIME, 0.0, base_arrives)], axis=1)
    tip = np.stack(2 * [ramp(tip_starts, 2.0, 1.2)], axis=1)
    touch = np.stack(
        [ramp(t, 20.0, 8.0) for t in 2 * (base_arrives,) + 2 * (tip_starts + 0.6,)],
        axis=1,
    )
    proximity = np.stack(
        [0.01 - ramp(t, 1.0, 0.0105) for t in 2 * (0.99,) + 2 * (1.5,)], axis=1
    )
    sequence = ClosingSequence(
        time=TIME,
        angle=np.concatenate([base, tip], axis=1),
        proximity=proximity,
        touch=touch,
        shift=0.0 * TIME,
        wire_force=np.stack(2 * [ramp(0.1, 60.0, 100.0)], axis=1),
        wire_limit=100.0,
    )
    return dc.replace(sequence, **changes)


def failed(rows):
    return {row.quantity for row in rows if not row.passed}


def test_closing_the_base_first_and_then_the_tip_passes():
    assert failed(judge("wires", made_up(tip_starts=1.05))) == set()


def test_a_tip_that_starts_early_fails():
    assert failed(judge("wires", made_up(tip_starts=0.8))) == {
        "tip starts after the base touches"
    }


def test_proximity_may_start_the_tip_before_the_touch():
    early = made_up(tip_starts=1.01)
    assert failed(judge("wires", early)) == {"tip starts after the base touches"}
    assert failed(judge("Algorithm 1, proximity", early)) == set()


def test_a_hand_that_misses_the_can_fails():
    missed = made_up(touch=np.zeros((len(TIME), 4)))
    assert "smallest touch force at the end" in failed(judge("wires", missed))
    assert "tip touches after the base" in failed(judge("wires", missed))


def test_a_wire_force_beyond_the_servo_fails():
    assert "largest wire force" in failed(judge("wires", made_up(wire_limit=90.0)))


@pytest.mark.parametrize(("off", "passes"), [(0.01, True), (0.05, False)])
def test_another_posture_fails(off, passes):
    wires = made_up()
    other = dc.replace(wires, angle=wires.angle + off)
    rows = judge_agreement({"wires": wires, "other": other})
    assert (failed(rows) == set()) == passes


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wires", "Algorithm 1, touch"])
def test_a_hand_closes_around_the_can(name):
    sequence = close(DRIVERS[name], duration=1.7)
    rows = [row for row in judge(name, sequence) if "at the end" not in row.quantity]
    assert failed(rows) == set()


def test_every_driver_gets_a_table_and_a_column_of_the_figure(monkeypatch):
    monkeypatch.setattr(closing_sequence, "close", lambda driver: made_up())
    result = closing_sequence.run(quiet)
    assert set(result.tables) == {
        "wires",
        "algorithm_1_proximity",
        "algorithm_1_touch",
    }
    assert len(result.figure.axes) == 4 * len(DRIVERS)
