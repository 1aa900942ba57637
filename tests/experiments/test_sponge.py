import dataclasses as dc

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import sponge
from drake_srg.experiments.sponge import FOAM, SIZE, Case, Grasp
from drake_srg.objects.config import ObjectConfig
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box

pytestmark = pytest.mark.slow

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
