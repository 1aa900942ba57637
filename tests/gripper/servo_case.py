"""A servo of two joints, and its inputs."""

import dataclasses as dc

import numpy as np
from helpers import fix, read, update

from drake_srg.gripper.servo import GripperServo, GripperServoConfig

GAINS = GripperServoConfig(
    kp=[2.0, 1.0], ki=[0.5, 0.0], kd=[0.1, 0.2], kff1=[0.03, 0.02], kff2=[1e-3, 2e-3]
)
# [q; v; a] and [q; v] of two joints that keep the PWM below 1.
REFERENCE = np.array([0.3, 0.2, 1.0, -0.5, 5.0, 6.0])
MEASURED = np.array([0.2, 0.25, 0.6, 0.1])
TARGET = np.array([0.35, 0.1])
# By hand: kff1 v + kff2 a + kp e + kd (v - v measured)
PID = np.array(
    [
        0.03 * 1.0 + 1e-3 * 5.0 + 2.0 * 0.1 + 0.1 * 0.4,
        0.02 * -0.5 + 2e-3 * 6.0 + 1.0 * -0.05 + 0.2 * -0.6,
    ]
)


def make(reference=REFERENCE, measured=MEASURED, config=GAINS, **changes):
    servo = GripperServo(dc.replace(config, **changes))
    context = servo.CreateDefaultContext()
    fix(servo, context, reference=reference, state_measured=measured)
    return servo, context


def pwm(servo, context):
    update(servo, context)
    return read(servo, context, "pwm")
