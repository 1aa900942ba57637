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


def test_it_comes_out_the_same_whether_somebody_looks_or_not(held):
    for field in dc.fields(Grasp):
        one, other = (getattr(result, field.name) for result in held)
        if isinstance(one, np.ndarray) and field.name != "picture":
            assert one.tobytes() == other.tobytes(), field.name


def test_a_servo_cannot_pull_any_harder_than_it_can():
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
def test_the_gap_between_the_pads_is_that_of_the_datasheet(rig, degrees, gap):
    base = np.deg2rad(degrees)
    state = np.array([[base, base, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    # The ends of the pads are the nearest at 45 degrees, their middles are further off.
    further = 2.0 * 0.025 * np.cos(base)
    found = sponge._pad_gap(rig, state)
    assert found == pytest.approx([gap + further], abs=1e-3)


def test_a_free_sponge_has_the_volume_that_it_has(rig):
    elements = sponge._Elements(rig)
    assert elements.least_volume() == pytest.approx(1.0)
    np.testing.assert_allclose(np.ptp(elements.vertices(), axis=1), SIZE)


def test_an_inverted_element_is_found(rig):
    elements = sponge._Elements(rig)
    p = elements.vertices()
    moved = p.copy()
    moved[2, np.argmin(p[2])] += 2.0 * SIZE[2]
    body, context = elements._body, elements._context
    body.SetPositions(context, moved)
    try:
        assert elements.least_volume() < 0.0
    finally:
        body.SetPositions(context, p)


# What is judged.


def made_up(squeeze):
    """A grasp of the squeeze that Hooke's law gives for its force."""
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
    names = (*soft.COMMANDS, "half the step", "finer mesh", "harder and harder")
    grasps = {name: made_up(0.12 if name == "gentle" else 0.3) for name in names}
    grasps["strong"] = dc.replace(grasps["strong"], **changes)
    return judge(grasps)


def failed(**changes):
    rows = rows_of(**changes)
    return {row.quantity for row in rows if not row.passed and row.name == "strong"}


def test_what_elasticity_gives_passes():
    assert all(row.passed for row in rows_of())


@pytest.mark.parametrize(
    ("changes", "quantity"),
    [
        ({"lifted": 0.0}, "lifted off the table by"),
        ({"touched": {"gripper", "support"}}, "held for"),
        ({"least_volume": -0.1}, "least volume of an element"),
        ({"least_volume": np.nan}, "least volume of an element"),
        ({"expected_force": 25.0}, "grip force, from the wires'"),
        ({"squeeze": made_up(0.4).squeeze}, "squeeze, about F / (E A_side)"),
        ({"squeeze": made_up(0.6).squeeze}, "squeeze, at most F / (E A_pad)"),
        ({"squeeze": made_up(0.1).squeeze}, "squeeze, at least F / (M A_side)"),
    ],
)
def test_what_is_wrong_fails(changes, quantity):
    assert quantity in failed(**changes)


def test_a_sponge_that_slips_is_not_held():
    slow = made_up(0.3).time * 0.01
    assert failed(moved=slow) >= {"held for", "creep in the last second"}


def test_where_it_is_squeezed_out_is_told():
    calm = made_up(0.3)
    (row, *_) = soft._tell_ramp("x", calm)
    assert row.quantity == "still held at a grip force of"
    gone = np.where(calm.time > 8.0, 0.02, 0.0)
    row, *_ = soft._tell_ramp("x", dc.replace(calm, moved=gone, force=calm.time))
    assert row.quantity == "squeezed out at a grip force of"
    assert row.measured == pytest.approx(8.0, abs=0.051)
