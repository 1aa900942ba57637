"""Desired velocities of a plant's PD actuators, as torques.

CENIC takes the velocities of `desired_state` with the opposite sign, in Drake 1.51.1
as in 1.58; tests/common/test_velocity_feedforward.py tells once it no longer does. A
joint then lags by 2 kd / kp times its speed. With the velocity's share in `actuation`
instead, the law is the same with every integrator.
"""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain

from drake_srg.types import Vector


def AddVelocityFeedforward(
    builder: DiagramBuilder, desired: OutputPort, kd: Vector, name: str = ""
) -> tuple[OutputPort, OutputPort]:
    """Split a desired state into a desired position and a torque.

    The plant's PD actuators then make kp (q_d - q) - kd v + kd v_d, as with the desired
    state itself, and keep their effort limits.

    Args:
        builder: Of the diagram that has `desired`.
        desired: Desired state [q; v] (2N).
        kd: Damping of the actuators (N) [N m s / rad or N s / m].
        name: Prefix of the systems' names.

    Returns:
        [q; 0] (2N), for the plant's `desired_state`, and kd v (N) [N m or N], for its
        `actuation`.
    """
    n = len(kd)
    zero = np.zeros((n, n))
    position = builder.AddNamedSystem(
        f"{name}desired_position", MatrixGain(np.diag([*np.ones(n), *np.zeros(n)]))
    )
    torque = builder.AddNamedSystem(
        f"{name}velocity_feedforward", MatrixGain(np.hstack([zero, np.diag(kd)]))
    )
    for system in (position, torque):
        builder.Connect(desired, system.get_input_port())
    return position.get_output_port(), torque.get_output_port()
