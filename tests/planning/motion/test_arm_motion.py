import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.planning.motion.arm_motion import Motion
from planning.planning_world import motion as straight

START, END = np.array([0.0, 1.0]), np.array([1.0, 1.0])
# From START to END in 0.1 s, from 5 s on.
UNDER_WAY = Motion(np.zeros(2)).followed_by(straight(START, END), 5.0)
STOP = 0.4  # duration of a stop [s]
moments = st.floats(0.0, 0.09)


def test_without_a_trajectory_the_arm_rests():
    rest = Motion(START)
    for time in (0.0, 9.0, np.inf):
        np.testing.assert_array_equal(rest.position(time), START)
    assert rest.stopped(1.0) is rest


def test_a_motion_ends_at_its_destination():
    np.testing.assert_allclose(UNDER_WAY.position(5.05), [0.5, 1.0])
    np.testing.assert_allclose(UNDER_WAY.position(9.0), END)
    np.testing.assert_allclose(UNDER_WAY.destination, END)
    assert UNDER_WAY.due == pytest.approx(5.1)


def test_the_error_is_that_of_the_joint_farthest_off():
    assert UNDER_WAY.error(np.array([0.4, 1.2]), 5.05) == pytest.approx(0.2)


def test_a_wait_delays_only_when_the_motion_is_due():
    waiting = Motion(START).followed_by(straight(START, END), 5.0, wait=0.3)
    assert waiting.due == pytest.approx(5.4)
    np.testing.assert_allclose(waiting.position(5.1), END)


@given(moments)
def test_a_stop_brakes_evenly_along_the_path(moment):
    stopped = UNDER_WAY.stopped(5.0 + moment)
    assert stopped.due == pytest.approx(5.0 + moment + STOP)
    times = 5.0 + moment + np.linspace(0.0, STOP, 50)
    q = np.array([stopped.position(t) for t in times])
    np.testing.assert_allclose(q[0], UNDER_WAY.position(times[0]), atol=1e-12)
    np.testing.assert_array_equal(q[:, 1], 1.0)  # on the path
    speeds = np.diff(q[:, 0]) / np.diff(times)
    assert np.all(speeds >= -1e-9)
    assert np.all(np.diff(speeds) <= 1e-6)
    np.testing.assert_array_equal(stopped.position(99.0), stopped.destination)


@given(moments, st.floats(0.0, 1.0))
def test_an_arm_that_stops_stops_only_once(moment, later):
    stopped = UNDER_WAY.stopped(5.0 + moment)
    assert stopped.stopped(5.0 + moment + later) is stopped


@given(moments)
def test_a_motion_that_is_broken_off_comes_to_rest_by_itself(moment):
    ended = UNDER_WAY.ended(5.0 + moment)
    expected = UNDER_WAY.stopped(5.0 + moment)
    for time in 5.0 + moment + np.array([0.0, 0.1, 1.0]):
        np.testing.assert_array_equal(ended.position(time), expected.position(time))


def test_a_motion_that_is_over_leaves_the_arm_at_rest():
    ended = UNDER_WAY.ended(5.2)
    assert ended.trajectory is None
    np.testing.assert_allclose(ended.position(6.0), END)


@given(st.floats(0.0, 0.5))
def test_the_next_motion_knows_where_the_last_one_was(moment):
    following = UNDER_WAY.followed_by(None, 5.0 + moment)
    np.testing.assert_array_equal(
        following.position(9.0), UNDER_WAY.position(5.0 + moment)
    )


@pytest.mark.parametrize(
    ("time", "off", "arrived"),
    [(5.05, 0.0, False), (5.2, 0.0049, True), (5.2, 0.0051, False)],
)
def test_an_arm_arrives_when_the_motion_is_over_and_it_has_followed(time, off, arrived):
    to_rest = Motion(START).followed_by(
        PiecewisePolynomial.CubicHermite(
            [0.0, 0.1], np.array([START, END]).T, np.zeros((2, 2))
        ),
        5.0,
    )
    assert to_rest.arrived(END + off, time) == arrived
    assert Motion(START).arrived(END, time)


@pytest.mark.parametrize(("behind", "arrived"), [(0.03, True), (0.6, False)])
def test_an_arm_that_does_not_rest_there_may_be_a_little_behind(behind, arrived):
    speed = (END - START) / 0.1
    assert UNDER_WAY.arrived(END - behind * speed, 5.1) == arrived
    assert not UNDER_WAY.arrived(END - np.array([0.0, 0.01]), 5.1)  # that one rests
    # A sum of times may be a little less than the same time.
    assert UNDER_WAY.arrived(END, np.nextafter(5.1, 0.0))


@given(moments)
def test_a_resumed_motion_ends_where_it_would_have(moment):
    stopped = UNDER_WAY.stopped(5.0 + moment)
    since, q = stopped.nearest(stopped.destination)
    np.testing.assert_allclose(q, stopped.destination, atol=1e-9)
    resumed = stopped.resumed(9.0, since)
    np.testing.assert_allclose(resumed.position(9.0), stopped.destination, atol=1e-9)
    np.testing.assert_allclose(resumed.destination, END, atol=1e-9)
    times = 9.0 + np.linspace(0.0, 1.0, 200)
    x = np.array([resumed.position(t)[0] for t in times])
    assert np.all(np.diff(x) > -1e-12)  # along the path, never back
    assert x[1] - x[0] < 1e-3  # from rest


def test_the_nearest_point_is_not_beyond_the_stop():
    stopped = UNDER_WAY.stopped(5.01)
    _, q = stopped.nearest(END)
    np.testing.assert_allclose(q, stopped.destination, atol=1e-9)
    _, q = stopped.nearest(np.array([0.05, 7.0]))
    np.testing.assert_allclose(q, [0.05, 1.0], atol=0.01)


def test_a_rest_is_resumed_as_a_rest():
    rest = Motion(START)
    np.testing.assert_array_equal(rest.resumed(1.0, 0.0).position(2.0), START)
    np.testing.assert_array_equal(rest.nearest(END)[1], START)


@given(moments)
def test_a_motion_that_is_led_aside_goes_on_without_a_jump(moment):
    now, q = 5.0 + moment, np.array([0.3, -0.2])
    after, soon = UNDER_WAY.led_to(q, now), now + 1e-4
    assert after.position(now) == pytest.approx(UNDER_WAY.position(now))
    np.testing.assert_allclose(
        after.position(soon), UNDER_WAY.position(soon), atol=1e-5
    )
    assert after.destination == pytest.approx(q)
    assert after.q_rest == pytest.approx(q)
