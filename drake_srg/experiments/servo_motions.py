"""Motions that the servo laws are compared on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.servo_bench import STEP, Motion
from drake_srg.gripper.drivers import SrgPositionDriver
from drake_srg.types import Vector

SHIPPED = SrgPositionDriver().servo  # gains of the driver
START, END, START_TIME = 0.5, 1.0, 0.1  # of the step [rad], [rad], [s]
LOAD = -0.2  # 1.8 N at the end of a straight finger [N m]
OPENING_TIME = 1.0  # of closing and opening [s]
BLOCKED = (0.1, 0.6)  # while 1 N m, more than the limit, holds the fingers open [s]
LIMIT = 0.3  # of the step, which asks for 1.48 of full PWM with the shipped gains


def _step(time: Vector) -> tuple[Vector, Vector, Vector]:
    q = np.where(time > START_TIME, END, START)
    return q, 0.0 * q, 0.0 * q


def _rest(time: Vector) -> tuple[Vector, Vector, Vector]:
    q = np.full_like(time, END)
    return q, 0.0 * q, 0.0 * q


def _move(
    time: Vector, start_time: float, distance: float
) -> tuple[Vector, Vector, Vector]:
    """Return a minimum-jerk move from 0 by a distance [rad], at the joints' speed."""
    duration = 15.0 / 8.0 * abs(distance) / SRG.joint_speed
    blend = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])  # as in minimum_jerk.py
    share = np.clip((time - start_time) / duration, 0.0, 1.0)
    q, v, a = (distance * blend.deriv(k)(share) / duration**k for k in range(3))
    return q, v, a


def _close_and_open(time: Vector) -> tuple[Vector, Vector, Vector]:
    """Return 0.3 to 1.3 rad and back with minimum jerk."""
    closing = _move(time, START_TIME, 1.0)
    opening = _move(time, OPENING_TIME, -1.0)
    q, v, a = (there + back for there, back in zip(closing, opening, strict=True))
    return 0.3 + q, v, a


def _closed_and_opened(time: Vector) -> Vector:
    return np.where((time > START_TIME) & (time <= OPENING_TIME), 1.3, 0.3)


def _grip(time: Vector) -> tuple[Vector, Vector, Vector]:
    """Return a minimum-jerk move to where closing hands send their base joints."""
    q, v, a = _move(time, START_TIME, SRG.joint_limit - START)
    return START + q, v, a


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
    # The fingers meet at 1.76 rad, before the reference arrives, and press.
    "grip": Motion(
        _grip, 1.0, target=lambda t: np.where(t > START_TIME, SRG.joint_limit, START)
    ),
    "minimum_jerk": Motion(_close_and_open, 1.0, target=_closed_and_opened),
    "minimum_jerk_limited": Motion(
        _close_and_open, _tight_limit(_close_and_open), target=_closed_and_opened
    ),
    "sine_limited": Motion(_sine, _tight_limit(_sine)),
    "sine": Motion(_sine, 1.0),
}
