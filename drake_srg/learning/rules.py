"""Hand-written policies of our environments: what a learner must beat."""

from __future__ import annotations

import numpy as np

from drake_srg.learning.network import Array

# How the environments scale lengths in their observations [m].
_SIZE, _NEAR = 0.15, 0.2
_LOWEST, _HIGHEST = 0.025, 0.115  # heights of a one-shot grasp above the table [m]
_STEP = np.array([0.02, 0.02, 0.02, 0.1])  # a full action of Pick [m, rad]
# Share of an error that one action corrects: the hand lags by a control period or two,
# and the full error makes it swing by 1 cm.
_GAIN = 0.4
_ALIGNED, _LEVEL = 0.006, 0.006  # m
_TURNED = 0.08  # rad
_STILL = 0.1  # of the joints' scaled speeds
CLOSED = 0.9  # closure of the grasp
_WIDE = 0.09  # a side that the hand had better not close across [m]
# How `PickPlaceEnv` scales the goal, and how near to it the hand is over it [m].
_FAR, _OVER = 0.6, 0.01
# Height of the hand on the way, and above where it lets go; the error in height that
# one action corrects on the way down, at most [m].
_CARRIED, _DROP, _LOWERING = 0.16, 0.002, 0.02
_DOWN = 0.002  # within this of it, the hand lets go [m]


def grasp_height(size_z: float) -> float:
    """Return the height above the table at which to grasp an upright object [m]."""
    return float(np.clip(0.5 * size_z, _LOWEST, _HIGHEST))


def grasp_one_shot(observation: Array) -> Array:
    """Grasp in the middle, across the narrower side."""
    size_x, size_y, size_z = _SIZE * observation[:3].astype(float)
    height = grasp_height(size_z)
    z = 2.0 * (height - _LOWEST) / (_HIGHEST - _LOWEST) - 1.0
    # At no turn, the fingers close along the object's y.
    turn = 0.0 if size_y <= size_x else 1.0
    return np.array([0.0, 0.0, z, turn, -1.0, 2.0 * CLOSED - 1.0], np.float32)


def pick(observation: Array, still: float = _STILL, narrower: float = 0.0) -> Array:
    """Come from above, close across the nearer side, wait until it stands, lift.

    The nearer side, not the narrower one: a network that imitates the rule cannot tell
    which side of a nearly square box is narrower, and would turn halfway. `narrower`
    weighs one against the other. The hand turns to a narrower side that is farther
    counterclockwise only: a network halves what goes either way.

    Args:
        observation: Of Pick.
        still: Scaled speed of the joints below which the fingers are still.
        narrower: How much farther the hand turns for a narrower side [rad/m].
    """
    o = observation.astype(float)
    along = _NEAR * o[:2]
    turn = 0.5 * np.arctan2(o[4], o[3])
    size_x, size_y, size_z = _SIZE * o[6:9]
    period = np.pi
    if max(size_x, size_y) < _WIDE:
        period = 0.5 * np.pi
    elif size_y > size_x:
        turn += 0.5 * np.pi
    turn = (turn + 0.5 * period) % period - 0.5 * period
    if period < np.pi:
        wider = size_y - size_x if o[3] > 0.0 else size_x - size_y
        if narrower * wider > 0.5 * np.pi + 2.0 * turn:
            turn += 0.5 * np.pi
    if o[9] > 0.5:
        turn = 0.0
    closing = o[22] > 0.0
    resting = np.abs(o[14:18]).max() < still
    pressed = o[18:22].sum() > 0.0
    rise = 0.0
    height = _NEAR * o[5]
    if closing:
        along, turn = np.zeros(2), 0.0
        if resting and pressed:
            rise = _STEP[2] / _GAIN
    else:
        aligned = np.abs(along).max() < _ALIGNED and abs(turn) < _TURNED
        down = grasp_height(size_z) - height
        rise = down if aligned else 0.0
        closing = aligned and abs(down) < _LEVEL
    motion = _GAIN * np.array([*along, rise, turn]) / _STEP
    closure = 2.0 * CLOSED - 1.0 if closing else -1.0
    return np.clip(np.append(motion, closure), -1.0, 1.0).astype(np.float32)


def pick_place(observation: Array) -> Array:
    """Pick, carry the object high to over the goal, set it down, and rise."""
    o = observation.astype(float)
    goal, height = _FAR * o[25:27], _NEAR * o[5]
    away = np.abs(goal).max()
    closing, pressed = o[22] > 0.0, o[18:22].sum() > 0.0
    if not closing and away < _OVER:  # it has let go there
        return np.array([0.0, 0.0, 1.0, 0.0, -1.0], np.float32)
    grasped = grasp_height(_SIZE * o[8])
    if not (closing and pressed and height > grasped - _LEVEL):
        return pick(observation)
    down = grasped + _DROP - height
    if away < _OVER:
        rise = max(down, -_LOWERING)
    elif height < _CARRIED:
        return pick(observation)  # which lifts once the fingers are still
    else:
        rise = 0.0
    letting_go = away < _OVER and down > -_DOWN
    motion = _GAIN * np.array([*goal, rise, 0.0]) / _STEP
    closure = -1.0 if letting_go else 2.0 * CLOSED - 1.0
    return np.clip(np.append(motion, closure), -1.0, 1.0).astype(np.float32)


RULES = {
    "drake_srg/GraspOneShot-v0": grasp_one_shot,
    "drake_srg/Pick-v0": pick,
    "drake_srg/KitchenPick-v0": pick,
    "drake_srg/KitchenPickPlace-v0": pick_place,
}
