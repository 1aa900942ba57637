from types import SimpleNamespace

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import carrying
from drake_srg.experiments.carrying import LIMIT, STEPS, Carried, Case, carry, leaving

TIME = np.linspace(0.0, 1.0, 201)


def test_steps_leave_a_circle_by_half_the_step_times_speed_times_angle():
    angle, radius = np.pi / 2 * TIME, 0.3
    circle = radius * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    # The integral of speed times angular speed is speed times angle.
    expected = 0.5 * 0.004 * (0.3 * np.pi / 2) * np.pi / 2
    assert leaving(TIME, circle, 0.004)[-1] == pytest.approx(expected, rel=0.01)


def test_steps_do_not_leave_a_line():
    line = np.outer(TIME**2, [0.3, -0.2, 0.1])
    assert leaving(TIME, line, 0.004)[-1] == pytest.approx(0.0, abs=1e-9)


def test_a_body_on_the_tangent_of_each_step_leaves_the_path_by_that_much():
    step, radius, speed = 0.005, 0.3, np.pi / 2
    time = np.arange(0.0, 1.0, step)
    circle = radius * np.column_stack(
        [np.cos(speed * time), np.sin(speed * time), 0.0 * time]
    )
    v = speed * np.column_stack([-circle[:, 1], circle[:, 0], 0.0 * time])
    left = np.linalg.norm(circle[:-1] + step * v[:-1], axis=1) - radius
    assert np.sum(left) == pytest.approx(leaving(time, circle, step)[-1], rel=0.05)


def made_up(slide_of):
    return {
        Case(name, h): Carried(
            np.array([0.0, 1.0]), np.array([0.0, slide_of(h)]), np.array([0.0, 0.3 * h])
        )
        for name, (_, steps) in STEPS.items()
        for h in steps
    }


@pytest.mark.parametrize(
    ("slide_of", "passes"),
    [
        (lambda h: 0.25 * h, True),
        (lambda h: 0.25 * h + 0.9 * LIMIT, True),
        (lambda h: 0.25 * h + 1.1 * LIMIT, False),  # does not vanish with the step
        (lambda h: 0.3 * h + 0.1, False),  # lost
    ],
)
def test_a_slide_that_does_not_vanish_with_the_step_fails(slide_of, passes):
    rows = carrying.judge(made_up(slide_of))
    assert all(row.passed for row in rows) == passes


@pytest.mark.slow
def test_a_carried_cylinder_slides_no_farther_than_the_steps_move_it():
    carried = carry(Case("assistive_arm", 0.005))
    assert carried.time[-1] > 1.0
    assert 0.0 < carried.slide.max() < carried.leaving[-1] + LIMIT


def test_an_arm_that_carries_nothing_is_reported(monkeypatch):
    log = {"mode": np.zeros(3)}
    monkeypatch.setattr(
        carrying, "simulate_whole", lambda *_, **__: SimpleNamespace(log=log)
    )
    with pytest.raises(ScenarioError, match="the arm carries nothing"):
        carry(Case("assistive_arm", 0.005))
