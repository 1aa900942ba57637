import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import grasp_width
from drake_srg.experiments.grasp_width import CLAIM, judge, make_result
from drake_srg.experiments.grasp_width_cases import Grasp
from drake_srg.experiments.registry import quiet

HELD = Grasp(
    free=True,
    raised=0.08,
    slip=1e-4,
    closed=np.array([0.1, 1.5]),
    lifted=np.array([0.5, 0.8]),
    top=(0.085, 0.105),
)
LOST = dc.replace(HELD, free=False, raised=0.0)


def of_widths(widest, **thin):
    grasps = {
        f"box, {1e3 * w:.0f} mm": (w, HELD if w <= widest else LOST)
        for w in (0.1, CLAIM, 0.17, 0.2)
    }
    return grasps | {name: (0.001, g) for name, g in thin.items()}


def failed(rows):
    return {(row.name, row.quantity) for row in rows if not row.passed}


def test_boxes_wider_than_the_claim_may_be_lost():
    assert failed(judge(of_widths(CLAIM, sheet=HELD))) == set()
    assert failed(judge(of_widths(0.1))) == {
        ("boxes", "widest box held"),
        ("box, 145 mm", "free of its support"),
    }


def test_a_held_wider_box_does_not_make_up_for_a_lost_one():
    grasps = of_widths(0.2)
    grasps["box, 145 mm"] = (CLAIM, LOST)
    assert ("boxes", "widest box held") in failed(judge(grasps))


@pytest.mark.parametrize(
    ("result", "quantity"),
    [
        (LOST, "free of its support"),
        (dc.replace(HELD, slip=0.006), "slip while shaken"),
    ],
)
def test_a_lost_sheet_fails(result, quantity):
    assert failed(judge(of_widths(CLAIM, sheet=result))) == {("sheet", quantity)}


@pytest.mark.parametrize("result", [HELD, LOST], ids=["held", "lost"])
def test_the_experiment_passes_if_the_objects_are_held(monkeypatch, result):
    monkeypatch.setattr(grasp_width, "grasp", lambda thing: result)
    outcome = grasp_width.run(
        quiet, boxes=[0.16, 0.145], rods=[0.002], flat=[0.15], gaps=[0.006]
    )
    assert outcome.passed == result.held
    sizes = [0.145, 0.16, 0.00076, 0.0003, 0.002, 0.15]
    assert outcome.tables["grasps"]["size [m]"] == sizes
    assert len(outcome.figure.axes) == 4
    (table,) = make_result(of_widths(CLAIM)).tables.values()
    assert table["held"] == [1, 1, 0, 0]
