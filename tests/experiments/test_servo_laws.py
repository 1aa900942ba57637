import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import servo_laws
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.servo_bench import Motion, simulate
from drake_srg.experiments.servo_laws import LAWS
from drake_srg.experiments.servo_motions import MOTIONS, SHIPPED


def at_rest(time):
    return np.full_like(time, 0.5), 0.0 * time, 0.0 * time


@pytest.fixture(scope="module")
def result():
    with pytest.MonkeyPatch.context() as patch:
        laws = {name: LAWS[name] for name in ("pid", "printed")}
        patch.setattr(servo_laws, "LAWS", laws)
        responses = {}
        draw = servo_laws.draw
        patch.setattr(servo_laws, "draw", lambda r: responses.update(r) or draw(r))
        result = servo_laws.run(quiet)
        swapped = {
            motion: {"pid": by_law["printed"], "printed": by_law["pid"]}
            for motion, by_law in responses.items()
        }
        _, joint = simulate(SHIPPED, Motion(at_rest, 0.3, duration=0.01))
        yield result, servo_laws.judge(swapped, joint)


def test_the_laws_behave_as_theory_predicts(result):
    assert result[0].passed, result[0].table()


def test_each_law_fails_the_criteria_of_the_other(result):
    failed = {row.name for row in result[1] if not row.passed}
    assert failed == {"pid", "printed"}


def test_every_motion_has_a_table(result):
    assert set(result[0].tables) == set(MOTIONS)
    step = result[0].tables["step"]
    assert set(step) == {
        "time [s]",
        "reference [rad]",
        *(f"{law}: {what}" for law in ("pid", "printed") for what in LABELS),
    }
    assert np.max(step["pid: PWM"]) == MOTIONS["step"].force_limit


LABELS = ("angle [rad]", "PWM")


@pytest.mark.parametrize("name", ["minimum_jerk", "sine"])
def test_speed_and_acceleration_are_derivatives_of_the_angle(name):
    time = np.arange(0.0, 2.0, 1e-4)
    q, v, a = MOTIONS[name].reference(time)
    np.testing.assert_allclose(np.gradient(q, time)[1:-1], v[1:-1], atol=1e-3)
    np.testing.assert_allclose(np.gradient(v, time)[1:-1], a[1:-1], atol=2e-2)
    assert np.min(q) >= 0.0
    assert np.max(q) < 1.7  # straight fingers meet at 1.76
    assert np.max(np.abs(v)) < 3.67 + 1e-9


@pytest.mark.parametrize("torque", [0.0, 0.1, -0.1])
def test_without_a_servo_a_load_accelerates_the_joint(torque):
    zero = [0.0] * 4
    nothing = dc.replace(SHIPPED, kp=zero, kd=zero, kff1=zero, kff2=zero)
    motion = Motion(at_rest, 1.0, load=lambda t: 0.0 * t + torque, duration=0.05)
    response, joint = simulate(nothing, motion)
    expected = 0.5 + 0.5 * torque / joint.inertia * response.time**2
    # The joint's friction takes c v / torque, at most 13 %; a loose tip adds to that.
    allowed = 0.2 * np.abs(expected[-1] - 0.5) + 1e-9
    assert np.max(np.abs(response.q - expected)) < allowed
    assert np.all(response.pwm == 0.0)
