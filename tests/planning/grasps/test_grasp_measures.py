import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.planning.grasps.contact_patches import Patch
from drake_srg.planning.grasps.grasp_measures import (
    MEASURES,
    Body,
    cone_wrenches,
    friction_margin,
    resisted_acceleration,
    slip_margin,
    wrench_space,
)

# A hull takes milliseconds.
HULLS = settings(max_examples=5)
BODY = Body(mass=0.5, p_WB=np.zeros(3), size=0.05)


def pad(side, force=10.0, friction=0.6, half=0.01, shear=(0.0, 0.0)):
    """A square pad across y, with its corners as points."""
    corners = [(x, side * 0.03, z) for x in (-half, half) for z in (-half, half)]
    n = np.tile([0.0, -side, 0.0], (4, 1))
    f_W = np.array([shear[0], -side * force, shear[1]])
    return Patch(np.array(corners), n, np.full(4, force / 4), friction, f_W)


def pinch(**changes):
    return [pad(1.0, **changes), pad(-1.0, **changes)]


def test_two_points_resist_no_torsion_but_two_pads_do():
    points = [patch.centroid for patch in pinch()]
    assert not wrench_space(points, BODY).closed
    assert wrench_space(pinch(), BODY).closed
    assert wrench_space(pinch(), BODY).epsilon > 0.0


def test_one_side_has_no_force_closure():
    assert not wrench_space([pad(1.0)], BODY).closed


@HULLS
@given(st.floats(0.1, 1.0), st.floats(1.1, 2.0))
def test_more_friction_is_never_worse(friction, factor):
    low, high = (
        wrench_space(pinch(friction=mu), BODY) for mu in (friction, friction * factor)
    )
    assert high.epsilon >= low.epsilon - 1e-9
    assert high.volume >= low.volume - 1e-12


@HULLS
@given(st.floats(2.0, 50.0), st.floats(1.5, 3.0))
def test_pressing_harder_counts_only_where_forces_do(force, factor):
    low, high = (pinch(force=f) for f in (force, factor * force))
    assert wrench_space(low, BODY) == wrench_space(high, BODY)
    weighted = [wrench_space(p, BODY, weighted=True).epsilon for p in (low, high)]
    assert weighted[1] == pytest.approx(factor * weighted[0], rel=1e-6)
    assert friction_margin(high, BODY) == pytest.approx(
        factor * friction_margin(low, BODY)
    )


def test_wrenches_of_an_edge_are_on_its_cone():
    wrenches = cone_wrenches(pinch(friction=0.3), BODY)
    assert wrenches.shape == (8, 8, 6)
    normal, across = wrenches[:4, :, 1], wrenches[:4, :, [0, 2]]
    np.testing.assert_allclose(normal, -1.0)
    np.testing.assert_allclose(np.linalg.norm(across, axis=2), 0.3)


def test_a_pinch_bears_what_its_friction_allows_beyond_the_weight():
    # Upwards, both pads' friction less the weight; sideways (x), what remains of it.
    # The pyramid's edges lie along x and z.
    force, mu = 20.0, 0.6
    found = resisted_acceleration(pinch(force=force, friction=mu), BODY)
    most = 2.0 * mu * force / BODY.mass - 9.81
    assert 0.5 * most < found <= most + 1e-6


def test_a_pinch_that_cannot_carry_the_weight_resists_nothing():
    assert resisted_acceleration(pinch(force=1.0), BODY) == 0.0


@HULLS
@given(st.floats(5.0, 50.0))
def test_turning_the_world_changes_nothing(force):
    angle = 0.7
    R = np.array(
        [
            [np.cos(angle), -np.sin(angle), 0],
            [np.sin(angle), np.cos(angle), 0],
            [0, 0, 1],
        ]
    )
    turned = [
        dc.replace(p, p_W=p.p_W @ R.T, n_W=p.n_W @ R.T, f_W=R @ p.f_W)
        for p in pinch(force=force)
    ]
    assert slip_margin(turned) == pytest.approx(slip_margin(pinch(force=force)))
    # Pyramids turn with the contact's axes, so hulls agree but roughly.
    assert wrench_space(turned, BODY).epsilon == pytest.approx(
        wrench_space(pinch(force=force), BODY).epsilon, rel=0.3
    )


def test_the_slip_margin_is_the_unused_share_of_friction():
    assert slip_margin(pinch()) == 1.0
    assert slip_margin(pinch(shear=(0.0, 3.0))) == pytest.approx(0.5)
    assert slip_margin([pad(1.0), pad(-1.0, shear=(6.0, 0.0))]) == pytest.approx(0.0)
    assert slip_margin(pinch(friction=0.0)) == 0.0


@pytest.mark.parametrize("name", MEASURES)
def test_every_measure_prefers_a_pinch_to_no_contact(name):
    firm = pinch(force=50.0)
    assert MEASURES[name](firm, BODY) >= MEASURES[name]([], BODY) == 0.0


def test_the_centroid_keeps_the_force():
    patch = pad(1.0)
    np.testing.assert_allclose(patch.centroid.p_W, [[0.0, 0.03, 0.0]], atol=1e-12)
    assert patch.centroid.normal_force.tolist() == [10.0]
