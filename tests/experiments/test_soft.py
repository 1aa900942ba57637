import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import soft
from drake_srg.experiments.soft import judge
from drake_srg.experiments.sponge import CLOSE, FOAM, HOLD, LIFT, SIZE, Grasp


def made_up(squeeze):
    """A grasp whose squeeze and force obey Hooke's law."""
    time = np.arange(0.0, CLOSE + LIFT + HOLD + 0.01, 0.05)
    force = squeeze * FOAM.youngs_modulus * SIZE[0] * SIZE[2]
    return Grasp(
        time=time,
        squeeze=np.full_like(time, squeeze),
        force=np.full_like(time, force),
        wire_force=np.full_like(time, 100.0),
        moved=np.zeros_like(time),
        expected_force=force,
        lifted=0.06,
        touched={"gripper"},
        least_volume=0.7,
        picture=None,
    )


def rows_of(**changes):
    names = (*soft.PULLS, "half the step", "finer mesh", "ramp")
    grasps = {name: made_up(0.12 if name == "gentle" else 0.3) for name in names}
    grasps["strong"] = dc.replace(grasps["strong"], **changes)
    return judge(grasps)


def failed(**changes):
    rows = rows_of(**changes)
    return {row.quantity for row in rows if not row.passed and row.name == "strong"}


def test_a_grasp_that_obeys_elasticity_passes():
    assert all(row.passed for row in rows_of())


@pytest.mark.parametrize(
    ("changes", "quantity"),
    [
        ({"lifted": 0.0}, "lifted off the table by"),
        ({"touched": {"gripper", "support"}}, "held for"),
        ({"least_volume": -0.1}, "smallest volume of an element"),
        ({"least_volume": np.nan}, "smallest volume of an element"),
        ({"expected_force": 25.0}, "grip force, from the wire force"),
        ({"squeeze": made_up(0.4).squeeze}, "squeeze, about F / (E A_side)"),
        ({"squeeze": made_up(0.6).squeeze}, "squeeze, at most F / (E A_pad)"),
        ({"squeeze": made_up(0.1).squeeze}, "squeeze, at least F / (M A_side)"),
    ],
)
def test_every_deviation_fails_its_row(changes, quantity):
    assert quantity in failed(**changes)


def test_a_sponge_that_slips_is_not_held():
    slow = made_up(0.3).time * 0.01
    assert failed(moved=slow) >= {"held for", "creep in the last second"}


def test_a_ramp_reports_the_force_that_squeezes_the_sponge_out():
    calm = made_up(0.3)
    (row, *_) = soft.describe_ramp("x", calm)
    assert row.quantity == "grip force while still held"
    gone = np.where(calm.time > 8.0, 0.02, 0.0)
    row, *_ = soft.describe_ramp("x", dc.replace(calm, moved=gone, force=calm.time))
    assert row.quantity == "grip force when squeezed out"
    assert row.measured == pytest.approx(8.0, abs=0.051)
