import dataclasses as dc

import pytest

from drake_srg.experiments.compliance import (
    DRIVERS,
    ERRORS,
    Case,
    draw,
    jammed,
    judge,
    seated,
)
from drake_srg.experiments.insertion_stand import DEPTH, Inserted

SEATED = Inserted(stood=0.1e-3, height=1e-5, tilt=1e-3, peak=20.0, pressed=3.0)
# Stands on the rim from beginning to end.
JAMMED = dc.replace(SEATED, stood=DEPTH, height=DEPTH)


def trials(**changed):
    """All cases seat, but those of the stiff arm at 1 mm jam, or as `changed`."""
    made = {
        Case(driver, error): [
            JAMMED if (driver, error) == ("position", 1e-3) else SEATED
        ]
        * 100
        for driver in DRIVERS
        for error in ERRORS
    }
    for driver, own in changed.items():
        made[Case(driver, 1e-3)] = own
    return made


@pytest.mark.parametrize(
    ("change", "is_seated", "is_jammed"),
    [
        ({}, True, False),
        ({"stood": 0.6e-3}, True, True),  # it fell in once let go
        ({"height": 0.6e-3}, False, False),
        ({"height": -0.6e-3}, False, False),  # beside the table
        ({"tilt": 0.02}, False, False),
    ],
)
def test_what_counts_as_seated_and_as_jammed(change, is_seated, is_jammed):
    trial = dc.replace(SEATED, **change)
    assert (seated(trial), jammed(trial)) == (is_seated, is_jammed)


@pytest.mark.parametrize(
    ("changed", "failed"),
    [
        ({}, []),
        ({"position": [SEATED] * 100}, ["position, 1.0 mm: jammed, share"]),
        (
            {"impedance": [JAMMED] * 8 + [SEATED] * 92},
            ["impedance, 1.0 mm: seated, at least"],
        ),
    ],
)
def test_judgement(changed, failed):
    rows = judge(trials(**changed))
    assert [f"{row.name}: {row.quantity}" for row in rows if not row.passed] == failed


def test_the_figure_shows_both_drivers():
    share, peak, pressed = draw(trials()).axes
    for axis in (share, peak, pressed):
        assert len(axis.containers) == len(DRIVERS)
    assert list(share.containers[0].lines[0].get_ydata()) == [1, 1, 0, 1, 1]
