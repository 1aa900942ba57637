"""Motions that the servo laws are compared on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drake_srg.experiments.servo_bench import STEP, Motion
from drake_srg.gripper.drivers import SrgPositionDriver
from drake_srg.types import Vector

SHIPPED = SrgPositionDriver().servo  # gains of the driver
START, END, START_TIME = 0.5, 1.0, 0.1  # of the step [rad], [rad], [s]
LOAD = -0.2  # 1.8 N at the end of a straight finger [N m]
BLOCKED = (0.1, 0.6)  # while 1 N m, more than the limit, holds the fingers open [s]
LIMIT = 0.3  # of the step, which asks for 1.48 of full PWM with the shipped gains


def _step(time: Vector) -> tuple[Vector, Vector, Vector]:
    q = np.where(time > START_TIME, END, START)
    return q, 0.0 * q, 0.0 * q


def _rest(time: Vector) -> tuple[Vector, Vector, Vector]:
    q = np.full_like(time, END)
    return q, 0.0 * q, 0.0 * q


def _close_and_open(time: Vector) -> tuple[Vector, Vector, Vector]:
    """Return 0.3 to 1.3 rad and back with minimum jerk, at the joints' 3.67 rad/s."""
    duration = 15.0 / 8.0 * 1.0 / 3.67
    blend = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])  # as in minimum_jerk.py
    closing, opening = (np.clip((time - t) / duration, 0.0, 1.0) for t in (0.1, 1.0))
    q, v, a = (
        (blend.deriv(k)(closing) - blend.deriv(k)(opening)) / duration**k
        for k in range(3)
    )
    return 0.3 + q, v, a


def _sine(time: Vector) -> tuple[Vector, Vector, Vector]:
    """Return a sine between 0.4 and 1.2 rad at 1 Hz, from rest."""
    amplitude, w = 0.4, 2.0 * np.pi
    c, s = amplitude * np.cos(w * time), amplitude * np.sin(w * time)
    return 0.8 - c, w * s, w**2 * c


def _tight_limit(motion: Callable[[Vector], tuple[Vector, Vector, Vector]]) -> float:
    """Return 0.7 of the PWM that the feedforward of a motion asks for."""
    _, v, a = motion(np.arange(0.0, 2.0, STEP))
    return 0.7 * float(np.max(np.abs(SHIPPED.kff1[0] * v + SHIPPED.kff2[0] * a)))


MOTIONS = {
    "step": Motion(_step, LIMIT),
    # At 1 kHz, where the printed law does not start to oscillate.
    "load": Motion(
        _rest,
        LIMIT,
        load=lambda t: np.where(t > START_TIME, LOAD, 0.0),
        duration=4.0,
        servo_period=0.001,
    ),
    "blocked": Motion(
        _rest,
        LIMIT,
        load=lambda t: np.where((t > BLOCKED[0]) & (t <= BLOCKED[1]), -1.0, 0.0),
    ),
    "minimum_jerk": Motion(_close_and_open, 1.0),
    "minimum_jerk_limited": Motion(_close_and_open, _tight_limit(_close_and_open)),
    "sine_limited": Motion(_sine, _tight_limit(_sine)),
    "sine": Motion(_sine, 1.0),
}
