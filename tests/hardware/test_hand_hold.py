import numpy as np
from pydrake.systems.analysis import Simulator

from drake_srg.common.safety_states import SafetyState, StopReason, state_indices
from drake_srg.hardware.hand_hold import HandHold

PERIOD = 0.01


def test_commands_pass_only_while_the_arm_runs():
    system = HandHold(PERIOD)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    steps = [
        (SafetyState.RUNNING, 0.2, 0.2, 0.0),
        (SafetyState.RUNNING, 0.6, 0.6, 0.0),
        (SafetyState.BRAKING, 0.6, 0.6, 1.0),
        (SafetyState.BRAKING, 0.0, 0.6, 1.0),
        (SafetyState.PROTECTIVE_STOP, 1.0, 0.6, 1.0),
        (SafetyState.EMERGENCY_STOP, 0.0, 0.6, 1.0),
        (SafetyState.RUNNING, 0.3, 0.3, 0.0),
    ]
    for k, (state, commanded, allowed, hold) in enumerate(steps):
        system.GetInputPort("closure_commanded").FixValue(context, [commanded])
        indices = state_indices(state, StopReason.STALE)
        system.GetInputPort("safety_state").FixValue(context, np.array(indices))
        assert system.GetOutputPort("closure_allowed").Eval(context) == [allowed]
        assert system.GetOutputPort("hold").Eval(context) == [hold]
        simulator.AdvanceTo((k + 1) * PERIOD)
