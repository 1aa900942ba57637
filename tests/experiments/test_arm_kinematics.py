import pytest

from drake_srg.experiments.arm_kinematics import kinematics_error, kinematics_rows


@pytest.mark.slow
def test_the_plant_has_the_thesis_s_kinematics():
    # Rounding errors of products of six matrices; the thesis reports 0.06 degrees.
    assert kinematics_error() < 1e-9


@pytest.mark.slow
def test_the_printed_numbers_are_checked_as_in_the_thesis():
    rows = {row.quantity.partition(";")[0]: row for row in kinematics_rows()}
    assert all(row.passed for row in rows.values())
    assert rows["simulated arm against prediction"].expected == "<= 0.0402"
    section = rows["the same with the M of section 4.4.3"]
    assert section.measured == pytest.approx(0.2626, abs=1e-3)
