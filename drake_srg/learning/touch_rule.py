"""A hand-written policy of Pick for objects whose place is hardly known.

Pads catch what is off along the closing direction by 4 cm and more, but across it only
what is between them. So the hand, nearly closed, first pushes a cylinder across, from
beside: then it is known where it is. A box would turn as it is pushed. It is tried
where it was seen, then on one side of that, and then on the other.
"""

from __future__ import annotations

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.envs.pick import MAX_STEPS, STEP
from drake_srg.envs.workspace import LOWEST
from drake_srg.learning.network import Array
from drake_srg.learning.rules import CLOSED, grasp_height, pick
from drake_srg.planning.grasps.srg_angles import straight_base_angle

# How the environment scales lengths and angles in its observations [m, rad].
_SIZE, _NEAR = 0.15, 0.2
_ANGLE, _TURN = 2.0, np.pi
_GAIN = 0.4  # share of an error that one action corrects; see `rules`
# The hand comes down beside the estimate, four standard deviations of 20 mm
# away, and moves on until what it pushes has its middle 45 mm beyond it [m].
_BESIDE, _BEYOND = 0.08, 0.045
_SWEEP = 0.003  # per step, 6 cm/s: at twice that, it topples what is slender [m]
_OPEN = 0.05  # closure at which the fingers are level
# What it pushes lies between the pads' ends, which are this share of its width apart.
# Pads that meet let it roll off to the side, and then open against it.
_CRADLE = 0.4
_HALF_FINGER = 0.0155  # half the pads' width [m]
# The hand ends short of the middle: the finger's edge meets some objects, which are
# then nearer than those that its face meets [m].
_SHORT = 0.004
_BACK = 0.03  # off the object before the fingers open, which would drag it along [m]
# The palm is 91 mm above the grasp centre, and must not touch the object [m].
_PALM = 0.085
# Steps at which the hand is beside the object, is down there, has swept, is off it
# again, and has opened. Nothing else in an observation tells the phase.
_ASIDE_AT, _BESIDE_AT, _SWEPT_AT, _BACK_AT, _OPENED_AT = 11, 21, 56, 58, 67
# From this step on, fingers that are closed lift the cylinder: they rest by then.
_LIFTED_AT = 86
# Scaled speed of the joints below which the fingers are still. The closure that a
# network commands is never quite even, and Algorithm 1 bends tips that rest by up to
# 0.25 each time it changes: with the limit of `rules`, they were never still.
_STILL_BY_TOUCH = 0.3
# Until these steps, boxes are tried where they were seen, and on one side of that; then
# on the other. The hand, which turns by up to 135 degrees, has closed by the first. The
# sides are a pad's width and a little away [m].
_TRIED, _TRIED_AGAIN, _ASIDE = 40, 68, 0.04
# A side that is 5 mm narrower is worth a quarter turn more [rad/m]: on the longer side,
# the pads hold more of a box that they meet off its middle.
_TURN_PER_WIDTH = 0.5 * np.pi / 0.005
# If the gap between the pads is less than this share of the box's width, they hold
# nothing.
_NARROWER = 0.5
_LIFT = np.array([0.0, 0.0, 1.0, 0.0, 2.0 * CLOSED - 1.0], np.float32)
_EMPTY = np.array([0.0, 0.0, 0.5, 0.0, -1.0], np.float32)  # open, and rise by 1 cm


def pick_by_touch(observation: Array) -> Array:
    """Find an object by touch, and pick it up; see the module."""
    o = observation.astype(float)
    return _sweep(o) if o[9] > 0.5 else _retry(o)


TOUCH_RULES = dict.fromkeys(
    ("drake_srg/Pick-v0", "drake_srg/KitchenPick-v0"), pick_by_touch
)


def _sweep(o: Array) -> Array:
    """Sweep a cylinder to where it is known to be, and then pick it up."""
    step = _step(o)
    if step >= _LIFTED_AT and o[22] > 0.0:
        return _LIFT.copy()
    if step >= _OPENED_AT:
        return _pick_beside(o, np.array([_BEYOND - _SHORT, 0.0]))
    x, y = -_NEAR * o[:2]  # of the hand, from the estimate
    end = _BEYOND - _HALF_FINGER - 0.5 * _SIZE * o[6]
    height = max(LOWEST, _SIZE * o[8] - _PALM)
    base = straight_base_angle(0.5 * _CRADLE * _SIZE * o[6])
    closure = base / SRG.full_scale
    if step < _BESIDE_AT:
        goal = -_BESIDE
        if step < _ASIDE_AT:  # it may still be over the object
            height = _NEAR * o[5]
    elif step < _SWEPT_AT:
        goal = min(end, x + _SWEEP / _GAIN)
    elif step < _BACK_AT:
        goal = end - _BACK
    else:
        goal, height, closure = end - _BACK, grasp_height(_SIZE * o[8]), _OPEN
    motion = _GAIN * np.array([goal - x, -y, height - _NEAR * o[5], 0.0]) / STEP
    action = np.append(motion, 2.0 * closure - 1.0)
    return np.clip(action, -1.0, 1.0).astype(np.float32)


def _retry(o: Array) -> Array:
    """Pick a box up where it was seen, or else beside that."""
    across = o[3] > 0.0  # the fingers close along the box's y, not its x
    width = _SIZE * (o[7] if across else o[6])
    base = _ANGLE * o[10:12].mean()
    closed = o[22] > 0.0 and np.abs(o[14:18]).max() < _STILL_BY_TOUCH
    if closed and base > straight_base_angle(0.5 * _NARROWER * width):
        return _EMPTY.copy()
    yaw = _TURN * o[24]
    aside = 0.0
    if _step(o) >= _TRIED:
        aside = _ASIDE if _step(o) < _TRIED_AGAIN else -_ASIDE
    return _pick_beside(o, aside * np.array([np.cos(yaw), np.sin(yaw)]))


def _pick_beside(o: Array, away: Array) -> Array:
    """Pick as if the estimate were so far away from where it is, (2,) [m]."""
    place = o[:2] + away / _NEAR
    return pick(
        np.append(place, o[2:]).astype(np.float32), _STILL_BY_TOUCH, _TURN_PER_WIDTH
    )


def _step(observation: Array) -> int:
    return round(0.5 * MAX_STEPS * (float(observation[23]) + 1.0))
