import numpy as np
from hypothesis import given
from hypothesis.extra.numpy import arrays

from drake_srg.twin.torque_comparison import TorqueComparison

torques = arrays(float, 3, elements={"min_value": -300.0, "max_value": 300.0})


@given(torques, torques, torques)
def test_measured_is_expected_and_residual(needed, felt, simulated):
    system = TorqueComparison(3)
    context = system.CreateDefaultContext()
    measured = needed - felt
    for name, value in (
        ("torque_measured", measured),
        ("external_felt", felt),
        ("external_expected", simulated),
    ):
        system.GetInputPort(name).FixValue(context, value)
    expected = system.GetOutputPort("torque_expected").Eval(context)
    residual = system.GetOutputPort("torque_residual").Eval(context)
    np.testing.assert_allclose(expected, needed - simulated, atol=1e-9)
    np.testing.assert_allclose(expected + residual, measured, atol=1e-9)
