import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from drake_srg.robot.twin.station import LagCompensation

PERIOD = 0.01


@pytest.mark.parametrize("lag", [0.0, 0.03, 0.1])
def test_it_makes_up_for_the_lag_of_the_driver(lag):
    system = LagCompensation(2, PERIOD)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    speed, commands, q = np.array([1.0, -0.5]), [], np.zeros(2)
    delay = round(lag / PERIOD)
    for k in range(300):
        target = k * PERIOD * speed
        system.GetInputPort("state_measured").FixValue(
            context, np.concatenate([target, speed])
        )
        system.GetInputPort("state").FixValue(context, np.concatenate([q, speed]))
        commands.append(system.get_output_port().Eval(context).copy())
        simulator.AdvanceTo((k + 1) * PERIOD)
        # The commanded arm is where it was sent a while ago.
        q = commands[max(k + 1 - delay, 0)] if delay else target + PERIOD * speed
        q = q if not delay else commands[max(len(commands) - delay, 0)]
    error = q - (target + PERIOD * speed)
    np.testing.assert_allclose(error, 0.0, atol=0.015)


def test_an_arm_at_rest_teaches_nothing():
    system = LagCompensation(1, PERIOD)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("state_measured").FixValue(context, [0.5, 0.0])
    system.GetInputPort("state").FixValue(context, [0.0, 0.0])  # something blocks it
    simulator.AdvanceTo(5.0)
    assert system.lag(context) == 0.0
    assert system.get_output_port().Eval(context)[0] == 0.5
