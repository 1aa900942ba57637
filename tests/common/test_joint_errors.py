import numpy as np
import pytest
from helpers import fix, port_table, read, update
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_srg.common.joint_errors import (
    VELOCITY_WINDOW,
    AddEncoderNoise,
    AddLatency,
    ArmErrorsConfig,
    CommandErrors,
    EncoderErrors,
    JointErrorsConfig,
    TorqueErrors,
)

PERIOD = 0.01
angles = st.floats(-3.0, 3.0)


def follow(commands, latency=0.0, backlash=0.0):
    """Return [delayed, play] for one command per period, shape (K, 2)."""
    system = CommandErrors(1, latency, backlash, PERIOD)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    fix(system, context, commanded=commands[0])
    simulator.Initialize()
    rows = []
    for k, command in enumerate(commands):
        fix(system, context, commanded=command)
        simulator.AdvanceTo((k + 1) * PERIOD)
        simulator.AdvancePendingEvents()
        rows.append([read(system, context, "delayed")[0]])
        rows[-1].append(read(system, context, "play")[0])
    return np.array(rows)


@pytest.mark.parametrize(
    ("latency", "periods"), [(0.0, 0), (0.01, 1), (0.02, 2), (0.021, 3)]
)
def test_a_command_takes_effect_after_whole_periods(latency, periods):
    commands = np.arange(8.0)
    delayed = follow(commands, latency)[:, 0]
    expected = np.maximum(commands - periods, 0.0)
    np.testing.assert_allclose(delayed, expected)


def test_the_first_command_acts_until_the_latency_is_over():
    np.testing.assert_allclose(follow([1.5] * 4, latency=0.03)[:, 0], 1.5)


@given(st.lists(angles, min_size=1, max_size=30), st.floats(0.0, 0.5))
@settings(max_examples=30, deadline=None)
def test_a_joint_follows_only_as_far_as_the_play_demands(commands, backlash):
    delayed, play = follow(commands, backlash=backlash).T
    # The motor's side is u = y + play, within half the backlash on either side.
    np.testing.assert_allclose(delayed + play, commands, atol=1e-12)
    assert np.max(np.abs(play)) <= 0.5 * backlash + 1e-12
    moves = np.abs(np.diff(np.concatenate([[commands[0]], delayed])))
    needed = np.abs(np.concatenate([[0.0], np.diff(commands)]))
    assert np.all(moves <= needed + 1e-12)


def test_a_turn_back_is_lost_in_the_backlash():
    delayed = follow([0.0, 1.0, 0.95, 0.9, 0.5], backlash=0.2)[:, 0]
    np.testing.assert_allclose(delayed, [0.0, 0.9, 0.9, 0.9, 0.6], atol=1e-12)


def noise(seed, name="arm", sigma=1e-3, samples=2000):
    config = JointErrorsConfig(encoder_noise=sigma)
    system = EncoderErrors(2, config, PERIOD, seed, name)
    context = system.CreateDefaultContext()
    fix(system, context, state=np.zeros(4))
    rows = []
    for k in range(samples):
        update(system, context, k * PERIOD)
        rows.append(read(system, context, "state_measured"))
    return np.array(rows)


def test_noise_has_its_standard_deviation_and_zero_mean():
    sigma, window = 1e-3, VELOCITY_WINDOW
    rows = noise(0, sigma=sigma)
    expected = [sigma] * 2 + [np.sqrt(2.0) * sigma / window] * 2
    # Five standard errors of 2000 samples: of 1.6 % and of 2.2 %.
    np.testing.assert_allclose(rows.std(axis=0), expected, rtol=0.08)
    np.testing.assert_allclose(rows.mean(axis=0) / expected, 0.0, atol=0.11)
    correlation = np.corrcoef(rows[:-1, 0], rows[1:, 0])[0, 1]
    assert abs(correlation) < 0.11


def test_noise_depends_on_seed_and_name_alone():
    first = noise(3, samples=5)
    np.testing.assert_array_equal(first, noise(3, samples=5))
    assert not np.any(first == noise(4, samples=5))
    assert not np.any(first == noise(3, "gripper", samples=5))


def test_an_encoder_on_the_motors_side_measures_the_play():
    system = EncoderErrors(2, JointErrorsConfig(), PERIOD, 0, "arm")
    context = system.CreateDefaultContext()
    fix(system, context, state=[0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose(
        read(system, context, "state_measured"), [0.1, 0.2, 0.3, 0.4]
    )
    fix(system, context, play=[0.01, -0.02])
    np.testing.assert_allclose(
        read(system, context, "state_measured"), [0.11, 0.18, 0.3, 0.4]
    )


def test_torque_sensors_add_their_offset_and_noise():
    config = ArmErrorsConfig(torque_offset=-0.02, torque_noise=0.01)
    full_scale = np.array([100.0, 10.0])
    system = TorqueErrors(full_scale, config, PERIOD, 3)
    assert port_table(system) == ({"torque": 2}, {"torque_measured": 2})
    context = system.CreateDefaultContext()
    fix(system, context, torque=[5.0, -1.0])
    rows = []
    for k in range(2000):
        update(system, context, k * PERIOD)
        rows.append(read(system, context, "torque_measured"))
    errors = (np.array(rows) - [5.0, -1.0]) / full_scale
    # Five standard errors of 2000 samples: of 0.01 / sqrt(2000) and of 1.6 %.
    np.testing.assert_allclose(errors.mean(axis=0), -0.02, atol=1.2e-3)
    np.testing.assert_allclose(errors.std(axis=0), 0.01, rtol=0.08)
    update(system, context, 0.0)
    np.testing.assert_array_equal(read(system, context, "torque_measured"), rows[0])


def test_perfect_joints_need_no_systems():
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([0.0, 0.0]))
    sink = builder.AddSystem(EncoderErrors(1, JointErrorsConfig(), PERIOD, 0, "x"))
    state, command = source.get_output_port(), sink.GetInputPort("state")
    assert AddEncoderNoise(
        builder, state, JointErrorsConfig(), PERIOD, 0, "x"
    ).get_system().get_name() == (source.get_name())
    assert AddLatency(builder, command, 0.0, PERIOD).get_name() == "state"
    assert len(builder.GetSystems()) == 2
