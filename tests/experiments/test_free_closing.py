import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import free_closing
from drake_srg.experiments.free_closing import (
    STOPS,
    close,
    judge,
    judge_arms,
    judge_phases,
    vendor_closing,
)
from drake_srg.experiments.registry import quiet
from drake_srg.gripper.tendon import TendonDriveConfig, base_moment_arm, tip_moment_arm


def failed(rows):
    return [row.quantity for row in rows if not row.passed]


def test_the_vendor_s_table_agrees_with_itself():
    table = vendor_closing()
    assert failed(judge(table, table)) == []


@pytest.mark.parametrize("joint", ["base", "tip"])
@pytest.mark.parametrize("factor", [0.96, 1.04])
def test_a_deviation_of_four_percent_fails(joint, factor):
    table = vendor_closing()
    other = dc.replace(table, **{joint: factor * getattr(table, joint)})
    assert "angle at equal force" in failed(judge(other, table))


def test_small_angles_count_as_three_degrees():
    table = vendor_closing()
    for degrees, passes in ((0.08, True), (0.1, False)):
        tip = table.tip + np.where(table.tip > 0.0, np.deg2rad(degrees), 0.0)
        rows = judge(dc.replace(table, tip=tip), table)
        assert ("angle at equal force" in failed(rows)) != passes


def test_our_moment_arms_match_the_vendor_s():
    assert failed(judge_arms()) == []


def test_a_tip_that_starts_before_the_base_stops_fails():
    table = vendor_closing()
    assert failed(judge_phases({"vendor": table})) == []
    hurried = dc.replace(table, tip=np.maximum(table.tip, 0.001 * table.base))
    assert failed(judge_phases({"vendor": hurried})) != []


@pytest.mark.slow
def test_wires_springs_and_arms_balance(monkeypatch):
    monkeypatch.setattr(free_closing, "FINE_STEPS", 2)
    closing = close(STOPS["vendor"], steps=12)
    drive = TendonDriveConfig()
    for q, spring, arm, stop in (
        (closing.base, drive.base_spring, base_moment_arm, STOPS["vendor"][0]),
        (closing.tip, drive.tip_spring, tip_moment_arm, STOPS["vendor"][1]),
    ):
        free = (q > 1e-3) & (q < stop - 1e-3)
        assert np.count_nonzero(free) >= 3
        torque = spring.preload + spring.stiffness * q[free]
        np.testing.assert_allclose(
            closing.force[free] * arm(q[free]), torque, rtol=0.01
        )
    assert closing.asymmetry < 1e-6


def test_both_stops_are_compared_with_the_vendor_s_table(monkeypatch):
    def pretend(stops, steps):
        table = vendor_closing()
        return dc.replace(table, base=np.minimum(table.base, stops[0]))

    monkeypatch.setattr(free_closing, "close", pretend)
    result = free_closing.run(quiet)
    assert result.passed, result.table()
    assert set(result.tables) == {"vendor_stops", "ours_stops", "comparison"}
    assert len(result.figure.axes) == 3
