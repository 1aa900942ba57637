import dataclasses as dc

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import soft, sponge
from drake_srg.experiments.soft import judge
from drake_srg.experiments.sponge import CLOSE, FOAM, HOLD, LIFT, SIZE, Case, Grasp
from drake_srg.objects.config import ObjectConfig
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box

COARSE = Case(103.0, resolution=0.0225)


@pytest.fixture(scope="module")
def held():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sponge, "CLOSE", 2.5)
        return [
            sponge.grasp(COARSE, hold=0.5, picture=first) for first in (True, False)
        ]


def test_a_sponge_is_squeezed_lifted_and_held(held):
    result, _ = held
    assert result.touched == {"gripper"}
    assert result.lifted == pytest.approx(sponge.LIFT_HEIGHT, abs=0.005)
    assert result.moved[-1] < 1e-3
    assert result.force[-1] == pytest.approx(result.expected_force, rel=0.1)
    # Hooke's law of the whole block.
    strain = result.force[-1] / (FOAM.youngs_modulus * SIZE[0] * SIZE[2])
    assert result.squeeze[-1] == pytest.approx(strain, rel=0.2)
    assert 0.0 < result.least_volume < 1.0


def test_the_picture_shows_yellow_foam(held):
    r, g, b = np.moveaxis(held[0].picture.astype(int), -1, 0)
    assert np.mean((r > 150) & (g > 100) & (b < 100)) > 0.02


def test_taking_a_picture_does_not_change_the_outcome(held):
    for field in dc.fields(Grasp):
        one, other = (getattr(result, field.name) for result in held)
        if isinstance(one, np.ndarray) and field.name != "picture":
            assert one.tobytes() == other.tobytes(), field.name


def test_a_pull_beyond_the_servo_is_rejected():
    with pytest.raises(ScenarioError, match=r"the servo gives 0 \.\. 309 N"):
        sponge.grasp(Case(400.0))


@pytest.fixture(scope="module")
def rig():
    thing = ObjectConfig(
        shape=Box(SIZE), soft=FOAM, mass=0.01, friction=0.5, resolution=0.03
    )
    overrides = ["plant_config.time_step=0.005"]
    return Rig(bench_scenario(thing, home=[0.0, 0.0, 0.5], overrides=overrides))


@pytest.mark.parametrize(("degrees", "gap"), [(90.0, 0.0416), (45.0, 0.133)])
def test_the_gap_between_the_pads_matches_the_data_sheet(rig, degrees, gap):
    base = np.deg2rad(degrees)
    state = np.array([[base, base, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    # At 45 degrees the ends of the pads are nearest; their middles are farther apart.
    further = 2.0 * 0.025 * np.cos(base)
    found = sponge.pad_gap(rig, state)
    assert found == pytest.approx([gap + further], abs=1e-3)


def test_the_elements_of_a_free_sponge_have_their_free_volume(rig):
    elements = sponge.Elements(rig)
    assert elements.least_volume() == pytest.approx(1.0)
    np.testing.assert_allclose(np.ptp(elements.vertices(), axis=1), SIZE)


def test_an_inverted_element_is_found(rig):
    elements = sponge.Elements(rig)
    p = elements.vertices()
    moved = p.copy()
    moved[2, np.argmin(p[2])] += 2.0 * SIZE[2]
    body, context = elements.body, elements.context
    body.SetPositions(context, moved)
    try:
        assert elements.least_volume() < 0.0
    finally:
        body.SetPositions(context, p)


# Judging grasps.


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
