import dataclasses as dc

from drake_srg.experiments.hardware import judge
from drake_srg.robot.identify.log import vendor_log

REAL = vendor_log()


def test_a_gripper_agrees_with_itself_wherever_its_spool_sits():
    moved = [dc.replace(row, stop_counts=row.stop_counts - 1000.0) for row in REAL]
    rows = judge("specimen", REAL, moved)
    assert all(row.passed for row in rows)
    assert len(rows) == 3 * 9 + 2 * 12 + 5


def test_a_deviation_beyond_the_scatter_fails():
    off = [
        dc.replace(
            row,
            current_ma=1.11 * row.current_ma,
            stop_counts=row.stop_counts + (7.0 if row.test == "torque" else 0.0),
        )
        for row in REAL
    ]
    failed = {row.quantity for row in judge("specimen", REAL, off) if not row.passed}
    assert failed == {"current", "stop"}


def test_the_data_sheets_model_is_told_but_not_judged():
    off = [dc.replace(row, current_ma=2.0 * row.current_ma) for row in REAL]
    assert all(row.passed for row in judge("data sheet", REAL, off))
