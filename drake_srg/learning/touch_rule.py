"""A hand-written policy of Pick for objects whose place is hardly known."""

from __future__ import annotations

import numpy as np

from drake_srg.envs.pick import MAX_STEPS, STEP
from drake_srg.envs.workspace import LOWEST
from drake_srg.learning.network import Array
from drake_srg.learning.rules import grasp_height, pick

# How the environment scales lengths in its observations [m].
_SIZE, _NEAR = 0.15, 0.2
_GAIN = 0.4  # share of an error that one action corrects; see `rules`
# The closed hand comes down beside the estimate, four standard deviations of 20 mm
# away, and moves on until what it pushes has its middle 45 mm beyond it [m].
_BESIDE, _BEYOND = 0.08, 0.045
_SWEEP = 0.006  # per step, 0.13 m/s: faster, it topples what is slender [m]
_FIST, _OPEN = 0.6, 0.05  # closures: the pads just meet, and the fingers are level
_HALF_FINGER = 0.0155  # half the pads' width [m]
# The hand ends short of the middle: the finger's edge meets some objects, which are
# then nearer than those that its face meets [m].
_SHORT = 0.004
_BACK = 0.03  # off the object before the fingers open, which would drag it along [m]
# The palm is 91 mm above the grasp centre, and must not touch the object [m].
_PALM = 0.085
# Steps at which the hand is down beside the object, has swept, has opened, and is over
# the object. Nothing else in an observation tells the phase.
_BESIDE_AT, _SWEPT_AT, _OPENED_AT, _OVER_AT = 11, 28, 39, 45


def pick_by_sweep(observation: Array) -> Array:
    """Find a round object by sweeping, and then pick it up; boxes as `rules.pick` does.

    Pads catch what is off along the closing direction by 4 cm and more, but across it
    a cylinder only by half a pad's width. So the closed hand first pushes a cylinder
    across, from beside: then it is known where it is. A box cannot be pushed along its
    own sides, because the observation does not tell the hand's yaw in world.
    """
    o = observation.astype(float)
    step = round(0.5 * MAX_STEPS * (o[23] + 1.0))
    if o[9] <= 0.5 or step >= _OVER_AT + 1:
        return pick(observation)
    size_x, size_z = _SIZE * o[6], _SIZE * o[8]
    x, y = -_NEAR * o[:2]  # of the hand, from the estimate
    height, closure = max(LOWEST, size_z - _PALM), _FIST
    end = _BEYOND - _HALF_FINGER - 0.5 * size_x
    if step < _BESIDE_AT:
        goal = -_BESIDE
    elif step < _SWEPT_AT:
        goal = min(end, x + _SWEEP / _GAIN)
    elif step < _OPENED_AT:
        goal = end - _BACK
        closure = _FIST if step < _SWEPT_AT + 2 else _OPEN  # once it is back
    else:
        goal, height, closure = _BEYOND - _SHORT, grasp_height(size_z), _OPEN
    motion = _GAIN * np.array([goal - x, -y, height - _NEAR * o[5], 0.0]) / STEP
    if step == _OVER_AT:  # `pick` goes on from a hand that closes
        motion, closure = np.zeros(4), 0.9
    action = np.append(motion, 2.0 * closure - 1.0)
    return np.clip(action, -1.0, 1.0).astype(np.float32)
