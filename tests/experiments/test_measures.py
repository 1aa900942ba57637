"""The measures of trials: formulas without simulation, and a few with it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments import servo_laws
from experiments.before_modification import gripper_sdf
from experiments.bridge_load import Change, find_delays
from experiments.calibration import errors_of
from experiments.carrying import leaving
from experiments.closing import ramp
from experiments.envelope import bisect, cell
from experiments.grasp_measures import auc, auc_by_object, auc_error
from experiments.safety import make_stand
from experiments.servo_laws import MOTIONS, rise_time, settling_time
from experiments.singles import MESHES
from experiments.untouched import find_stay

TIME = np.linspace(0.0, 10.0, 10_001)


@given(lag=st.floats(0.05, 1.0), start=st.floats(-2, 2), step=st.floats(0.1, 2))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_first_order_lag_rises_in_its_time_constant_times_log_9(
    lag, start, step, sign
):
    end = start + sign * step
    q = start + (end - start) * (1 - np.exp(-TIME / lag))
    assert rise_time(TIME, q, start, end) == pytest.approx(lag * np.log(9), rel=1e-3)
    expected = lag * np.log(50)
    settled = settling_time(TIME, q - end, 0.02 * step)
    assert settled == pytest.approx(expected, abs=2e-3)


@given(damping=st.floats(0.05, 0.8))
def test_a_second_order_lag_overshoots_by_its_damping(damping):
    w, root = 20.0, np.sqrt(1 - damping**2)
    phase = w * root * TIME
    swing = np.cos(phase) + damping / root * np.sin(phase)
    share = 1 - np.exp(-damping * w * TIME) * swing
    q = servo_laws.START + (servo_laws.END - servo_laws.START) * share
    expected = np.exp(-np.pi * damping / root)
    assert servo_laws.overshoot(q) == pytest.approx(expected, abs=1e-3)


def test_a_response_that_never_arrives_has_no_times():
    assert np.isnan(rise_time(TIME, 0.08 * TIME, 0.0, 1.0))
    assert np.isnan(settling_time(TIME, np.sin(TIME), 0.1))


def test_a_response_that_starts_at_the_end_has_settled_at_once():
    assert settling_time(TIME, 0.0 * TIME, 0.1) == 0.0
    assert rise_time(TIME, 1.0 + 0.0 * TIME, 0.0, 1.0) == 0.0


@pytest.mark.parametrize("name", sorted(MOTIONS))
def test_speed_and_acceleration_are_derivatives_of_the_angle(name):
    time = np.linspace(0.0, 2.0, 200_001)
    q, v, a = MOTIONS[name].reference(time)
    smooth = np.abs(np.diff(q, prepend=q[0])) < 0.1  # a step has none
    assert np.abs(np.gradient(q, time) - v)[smooth].max() < (1e-3 if v.any() else 3e4)
    assert np.abs(np.gradient(v, time) - a)[1:-1].max() < 0.02 * max(1.0, abs(a).max())


CORNERS = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
WATCHED = np.arange(0.0, 30.0, 0.02)


def sliding(until, speed=0.01, then=0.0):
    """Return points of something that slides along x, then more slowly [m/s]."""
    x = speed * np.minimum(WATCHED, until) + then * np.maximum(WATCHED - until, 0.0)
    return CORNERS + x[:, np.newaxis, np.newaxis] * [1.0, 0.0, 0.0]


def test_all_must_have_been_slow_for_half_a_second():
    rest, moved = find_stay(WATCHED, {"a": sliding(2.0), "b": sliding(3.0)})
    assert rest == pytest.approx(3.5, abs=0.03)
    assert max(moved.values()) == pytest.approx(0.0, abs=1e-12)


def test_creep_counts_from_then_on():
    points = {"a": sliding(2.0), "b": sliding(1.0, then=3e-4)}
    _, moved = find_stay(WATCHED, points)
    assert moved["b"] == pytest.approx(10.0 * 3e-4)  # in ten seconds
    assert moved["a"] < moved["b"]


@pytest.mark.parametrize("until", [20.0, np.inf])
def test_what_moves_for_too_long_is_not_at_rest(until):
    assert find_stay(WATCHED, {"a": sliding(until)}) == (None, {})


def test_steps_leave_a_circle_by_half_the_step_times_speed_times_angle():
    time, radius, w = np.linspace(0.0, 1.0, 1001), 0.5, 2.0
    circle = radius * np.stack([np.cos(w * time), np.sin(w * time), 0 * time], axis=1)
    gone = leaving(time, circle, 0.002)
    assert gone[-1] == pytest.approx(0.5 * 0.002 * radius * w * w, rel=0.01)
    line = np.outer(time, [1.0, 2.0, 3.0])
    assert leaving(time, line, 0.002)[-1] == pytest.approx(0.0, abs=1e-9)


def test_delays_count_until_the_joint_leaves_its_rest():
    published = [(t, np.array([0.0 if t < 1.5 else 0.1, 0.0])) for t in range(4)]
    changes = [Change(0.5, 0, 0.0), Change(0.5, 1, 0.0)]
    delays = find_delays(published, changes)
    assert delays[0] == 1.5
    assert np.isnan(delays[1])


def test_one_kind_of_outcome_ranks_nothing():
    value, held = np.arange(4.0), np.ones(4, bool)
    assert np.isnan(auc(value, held))
    assert np.isnan(auc_by_object(value, held, np.array(["a"] * 4)))


def test_the_error_of_an_auc():
    # Their equation 1, worked by hand for 51 and 58 cases and an area of 0.893.
    held = np.arange(109) < 51
    assert auc_error(0.893, held) == pytest.approx(0.0325, abs=1e-4)
    assert np.isnan(auc_error(0.9, np.ones(3, bool)))


@pytest.mark.parametrize("flip", [False, True])
def test_auc_counts_pairs(flip):
    value, held = np.array([1.0, 2.0, 3.0]), np.array([False, True, True])
    assert auc(-value if flip else value, held) == (0.0 if flip else 1.0)
    assert auc(np.ones(3), held) == 0.5


@given(edge=st.floats(0.1, 0.9))
def test_bisection_finds_an_edge(edge):
    assert bisect(lambda x: x <= edge, 0.0, 1.0, 1e-3) == pytest.approx(edge, abs=1e-3)
    assert np.isnan(bisect(lambda x: False, 0.0, 1.0, 1e-3))


@pytest.mark.slow
def test_the_claimed_envelope_ends_at_its_limits():
    here = cell()
    ahead = here.center - [0.27, 0.0]
    assert here.claimed(ahead, 90.0, 15.0)
    assert here.claimed(ahead, 90.0, 180.0)  # a lying cylinder has two ends
    assert not here.claimed(ahead, 90.0, 16.0)
    assert not here.claimed(here.center - [0.29, 0.0], 90.0, 0.0)
    assert here.claimed(ahead, 30.0, -30.0)
    assert not here.claimed(ahead, 45.0, 0.0)
    z = here.pose(ahead, 90.0, 0.0).rotation().matrix()[:, 2]
    np.testing.assert_allclose(np.abs(z), [1.0, 0.0, 0.0], atol=1e-9)  # radial


def test_the_ramp_of_the_client_ends_closed():
    assert [ramp(t) for t in (0.0, 0.4, 20.0, 40.0, 50.0)] == [0.0, 0.01, 0.5, 1.0, 1.0]


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_meshes_are_closed_and_face_outwards(path):
    lines = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([line[1:] for line in lines if line[0] == "v"], dtype=float)
    triangles = np.array([line[1:] for line in lines if line[0] == "f"], dtype=int) - 1
    edges = {(int(t[i]), int(t[(i + 1) % 3])) for t in triangles for i in range(3)}
    assert edges == {(b, a) for a, b in edges}
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    assert np.einsum("ij,ij->", np.cross(a, b), c) > 0.0  # 6 times the volume


def test_pads_get_the_friction_that_the_rule_needs():
    text = gripper_sdf("curved", "hard", 0.4)
    own = 0.4 * 0.65 / (2 * 0.65 - 0.4)  # harmonic mean with the cylinder's 0.65
    assert f"<drake:mu_dynamic>{own:.6f}" in text


@pytest.mark.slow
def test_an_arm_settles_later_after_harder_stops():
    stand = make_stand()
    assert 0.05 < stand.settling_time(stand.home) < 1.0


def test_a_failed_calibration_has_no_errors():
    assert errors_of(None, None) is None
