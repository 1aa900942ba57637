import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.autodiffutils import AutoDiffXd

from drake_srg.experiments import data
from drake_srg.gripper.moment_arms import (
    base_moment_arm,
    tip_moment_arm,
    wire_travel,
)

ANGLES = st.floats(0.0, 1.745)


def table(joint):
    rows = csv.DictReader(data.read_csv("tendon_moment_arms.csv"))
    rows = [row for row in rows if row["joint"] == joint]
    return [
        np.array([float(r[k]) for r in rows]) for k in ("angle_rad", "moment_arm_m")
    ]


@pytest.mark.parametrize(
    ("joint", "arm"), [("base", base_moment_arm), ("tip", tip_moment_arm)]
)
def test_the_arms_are_those_of_the_vendors_table(joint, arm):
    angle, expected = table(joint)
    assert arm(angle) == pytest.approx(expected, rel=1e-3)


def test_the_travel_is_that_of_the_table():
    # From open to closed, the trapezium rule over the table gives 0.0291 m.
    expected = sum(np.trapezoid(*table(joint)[::-1]) for joint in ("base", "tip"))
    assert wire_travel(2.007129, 1.745329) == pytest.approx(expected, rel=1e-3)
    assert wire_travel(0.0, 0.0) == 0.0


@given(ANGLES, ANGLES)
def test_the_arms_are_the_derivatives_of_the_travel(base, tip):
    travel = wire_travel(AutoDiffXd(base, [1, 0]), AutoDiffXd(tip, [0, 1]))
    expected = [base_moment_arm(base), tip_moment_arm(tip)]
    assert travel.derivatives() == pytest.approx(expected, rel=1e-9)
