import dataclasses as dc

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import household
from drake_srg.experiments.data import household_objects
from drake_srg.experiments.grasping import HELD, Outcome, present
from drake_srg.experiments.household import OPENING, household_cases, judge
from drake_srg.experiments.registry import quiet
from drake_srg.simulation.rig import Rig

CASES = {str(case): case for case in household_cases()}
FIRM = Outcome(
    held_for=HELD,
    lifted=0.1,
    acceleration=9.7,
    settled=1e-4,
    sway=3e-3,
    slip=1e-3,
    turn=0.01,
    grip_force=30.0,
    wire_force=100.0,
    q=np.zeros(1),
    p_WL=np.zeros(3),
)


@pytest.mark.parametrize("name", household_objects())
def test_every_object_is_grasped_from_above_and_from_the_side(name):
    above, side = (CASES[f"{name}, {approach}"] for approach in ("above", "side"))
    p_x = [case.grasp.R_WG.matrix()[:, 0] for case in (above, side)]
    assert p_x[0][2] < -0.85  # the palm points down, or leans by up to 30 degrees
    assert abs(p_x[1][2]) < 1e-9
    assert above.possible
    assert side.possible
    assert above.grasp.why
    assert side.grasp.why


def test_the_pads_open_as_the_vendor_claims():
    assert pytest.approx(0.145, abs=1e-3) == OPENING


@pytest.mark.slow
def test_only_the_wide_faces_of_the_box_are_too_wide():
    (case,) = (case for case in CASES.values() if not case.possible)
    assert str(case) == "003_cracker_box, side, flat"
    assert case.width == pytest.approx(0.158)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_objects_rest_where_they_are_presented(name):
    case = CASES[name]
    with Rig(present(household_objects()[case.name], case.grasp)) as rig:
        rig.advance(0.05)
        pose = rig.log()["object_pose.thing"]
        touched = set(rig.contact_forces())
    # The card leans into its slot, the ball stands on a facet.
    assert np.linalg.norm(pose[-1, :3] - pose[0, :3]) < 1e-3
    assert touched <= {"support", "support_0", "support_1"}
    assert touched


def failed(name, **changes):
    rows = judge(CASES[name], dc.replace(FIRM, **changes))
    return [row.quantity for row in rows if not row.passed]


@pytest.mark.parametrize(
    ("changes", "quantities"),
    [
        ({}, []),
        ({"held_for": 7.0}, ["held by the hand alone for"]),
        ({"slip": 0.006}, ["slip"]),
        ({"turn": 0.2}, ["turn in the hand"]),
        ({"wire_force": 320.0}, ["wire force"]),
        ({"slip": np.nan}, ["slip"]),
    ],
)
def test_an_object_that_fits_must_be_held_firmly(changes, quantities):
    assert failed("mug, side", **changes) == quantities


def test_an_object_that_does_not_fit_must_slip():
    flat = "003_cracker_box, side, flat"
    assert failed(flat) == ["slip"]
    assert failed(flat, slip=0.01) == []
    assert failed(flat, held_for=0.2, slip=0.3) == []


@pytest.mark.slow
def test_every_outcome_is_in_the_table_and_the_figure(monkeypatch):
    cases = [CASES["mug, side"], CASES["003_cracker_box, side, flat"]]
    outcomes = iter([dc.replace(FIRM, slip=0.02), dc.replace(FIRM, slip=0.012)])
    monkeypatch.setattr(household, "household_cases", lambda: cases)
    monkeypatch.setattr(household, "simulate", lambda *_: next(outcomes))
    image = np.zeros((8, 8, 3), np.uint8)
    monkeypatch.setattr(household, "take_picture", lambda *_: image)
    result = household.run(quiet)
    table = result.tables["grasps"]
    assert table["object"] == ["mug", "003_cracker_box"]
    assert table["success"] == [False, False]
    assert table["as expected"] == [False, True]
    assert not result.passed
    captions = [axes.get_xlabel() for axes in result.figure.axes]
    assert "fails: held 7.5 s, slips 20.0 mm" in captions
    assert "too wide: 158 > 146 mm, slips 12 mm" in captions


@pytest.mark.slow
def test_chosen_objects_are_grasped_alone(monkeypatch):
    grasped = []
    monkeypatch.setattr(household, "simulate", lambda *_: FIRM)
    monkeypatch.setattr(household, "take_picture", lambda *_: np.zeros((8, 8, 3)))

    def track(cases, label=str):
        grasped.extend(str(case) for case in cases)
        yield from cases

    household.run(track, objects=["mug"])
    assert grasped == ["mug, above", "mug, side"]
    with pytest.raises(
        ScenarioError, match=r"unknown object 'mgu' \(did you mean 'mug'"
    ):
        household.run(track, objects=["mgu"])
