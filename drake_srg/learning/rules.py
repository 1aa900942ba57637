"""Hand-written and random policies, as baselines for learners.

`pick_by_touch` copes with wrong estimates. Along the closing direction, the pads catch
an object that is 4 cm or more off. Across that direction, the object must lie between
them. So the nearly closed hand first pushes a cylinder across, which determines its
place. A box would turn when pushed. Instead, the hand tries to grasp it where it was
seen, then on one side of that place, and then on the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import default_rng

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.srg_geometry import SRG
from drake_srg.learning.envs.scenes import LOWEST
from drake_srg.learning.envs.tasks import (
    ANGLE,
    FAR,
    HEIGHTS,
    MAX_STEPS,
    NEAR,
    SIZE,
    STEP,
    TURN,
)
from drake_srg.learning.episodes import Act
from drake_srg.learning.policy import Array
from drake_srg.planning.grasps.srg_hand import straight_base_angle

# Share of an error that one action corrects. The hand lags by a control period or two,
# and correcting the full error would make it swing by 1 cm.
_GAIN = 0.4
_ALIGNED, _LEVEL = 0.006, 0.006  # m
_TURNED = 0.08  # rad
_STILL = 0.1  # scaled speed of the joints below which the fingers are still
CLOSED = 0.9  # closure of the grasp
_WIDE = 0.09  # a wider side is too wide to close across [m]
_OVER = 0.01  # horizontal distance at which the hand counts as above the goal [m]
# Height of the hand while it carries the object, height of the object's release above
# the table, and the largest height error that one action corrects on the way down [m].
_CARRIED, _DROP, _LOWERING = 0.16, 0.002, 0.02
_DOWN = 0.002  # height error at which the hand lets go [m]


def grasp_height(size_z: float) -> float:
    """Return the height above the table at which to grasp an upright object [m]."""
    return float(np.clip(0.5 * size_z, *HEIGHTS))


def grasp_one_shot(observation: Array) -> Array:
    """Grasp in the middle, across the narrower side."""
    size_x, size_y, size_z = SIZE * observation[:3].astype(float)
    height = grasp_height(size_z)
    z = 2.0 * (height - HEIGHTS[0]) / (HEIGHTS[1] - HEIGHTS[0]) - 1.0
    # Without a turn, the fingers close along the object's y.
    turn = 0.0 if size_y <= size_x else 1.0
    return np.array([0.0, 0.0, z, turn, -1.0, 2.0 * CLOSED - 1.0], np.float32)


def pick(
    observation: Array,
    still: float = _STILL,
    narrower: float = 0.0,
    gain: float = _GAIN,
) -> Array:
    """Come from above, close across the nearer side, wait for still fingers, lift.

    The rule takes the side that needs the smaller turn, not the narrower one. A network
    that imitates the rule cannot see which side of a nearly square box is narrower, and
    would turn the hand halfway. `narrower` weighs width against turn. The larger turn,
    to a narrower side, is always counterclockwise, because a network would average two
    directions.

    Args:
        observation: Observation of `PickEnv`.
        still: Scaled speed of the joints below which the fingers are still.
        narrower: Additional turn that a narrower side is worth [rad/m].
        gain: Share of an error that one action corrects.
    """
    o = observation.astype(float)
    along = NEAR * o[:2]
    turn = 0.5 * np.arctan2(o[4], o[3])
    size_x, size_y, size_z = SIZE * o[6:9]
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
    height = NEAR * o[5]
    if closing:
        along, turn = np.zeros(2), 0.0
        if resting and pressed:
            rise = STEP[2] / gain
    else:
        aligned = np.abs(along).max() < _ALIGNED and abs(turn) < _TURNED
        down = grasp_height(size_z) - height
        rise = down if aligned else 0.0
        closing = aligned and abs(down) < _LEVEL
    motion = gain * np.array([*along, rise, turn]) / STEP
    closure = 2.0 * CLOSED - 1.0 if closing else -1.0
    return np.clip(np.append(motion, closure), -1.0, 1.0).astype(np.float32)


def pick_place(observation: Array) -> Array:
    """Pick, carry the object high above the goal, set it down, and rise."""
    o = observation.astype(float)
    goal, height = FAR * o[25:27], NEAR * o[5]
    away = np.abs(goal).max()
    closing, pressed = o[22] > 0.0, o[18:22].sum() > 0.0
    if not closing and away < _OVER:  # the hand has let go at the goal
        return np.array([0.0, 0.0, 1.0, 0.0, -1.0], np.float32)
    grasped = grasp_height(SIZE * o[8])
    if not (closing and pressed and height > grasped - _LEVEL):
        return pick(observation)
    down = grasped + _DROP - height
    if away < _OVER:
        rise = max(down, -_LOWERING)
    elif height < _CARRIED:
        return pick(observation)  # lifts once the fingers are still
    else:
        rise = 0.0
    letting_go = away < _OVER and down > -_DOWN
    motion = _GAIN * np.array([*goal, rise, 0.0]) / STEP
    closure = -1.0 if letting_go else 2.0 * CLOSED - 1.0
    return np.clip(np.append(motion, closure), -1.0, 1.0).astype(np.float32)


RULES = {
    "drake_srg/GraspOneShot-v0": grasp_one_shot,
    "drake_srg/Pick-v0": pick,
    "drake_srg/KitchenPick-v0": pick,
    "drake_srg/KitchenPickPlace-v0": pick_place,
}


# The hand comes down this far from the estimate: four standard deviations of 20 mm. It
# pushes the object until its middle is 45 mm beyond the estimate [m].
_BESIDE, _BEYOND = 0.08, 0.045
_SWEEP = 0.003  # per step [m], 6 cm/s; at twice this speed, slender objects topple
_OPEN = 0.05  # closure at which the fingers are straight
# Gap between the pads' ends during a push, as a share of the object's width. The gap
# keeps the object in front of the hand. If the pads met, the object would roll off to
# the side, and the pads would later open against it.
_CRADLE = 0.4
_HALF_FINGER = 0.0155  # half the pads' width [m]
# The pushed object is assumed to be this much nearer [m], because some objects touch
# the finger's edge instead of its face.
_SHORT = 0.004
# The hand backs off the object before the fingers open and would drag it along [m].
_BACK = 0.03
# The palm is 91 mm above the grasp centre, and must not touch the object [m].
_PALM = 0.085
# Steps at which the hand is beside the object, is down, has swept, has backed off, and
# has opened. The rule has no memory, so the step in an observation gives the phase.
_ASIDE_AT, _BESIDE_AT, _SWEPT_AT, _BACK_AT, _OPENED_AT = 11, 21, 56, 58, 67
# From this step on, closed fingers lift the cylinder. They are still by then.
_LIFTED_AT = 86
# Scaled speed of the joints below which the fingers are still. A network's closure
# command jitters, and each change makes Algorithm 1 bend resting tips, at scaled speeds
# up to 0.25. With the limit `_STILL`, such fingers would never be still.
_STILL_BY_TOUCH = 0.3
# Until the first step, the hand tries a box where it was seen; until the second, on one
# side; and then on the other. The first leaves time to turn by up to 135 degrees and to
# close. The distance to a side [m] is slightly more than a pad's width.
_TRIED, _TRIED_AGAIN, _ASIDE = 40, 68, 0.04
# A side that is 5 mm narrower is worth a quarter turn [rad/m]: off the box's middle,
# pads on the longer sides hold more of it.
_TURN_PER_WIDTH = 0.5 * np.pi / 0.005
# If the gap between the pads is less than this share of the box's width, they hold
# nothing.
_NARROWER = 0.5
_LIFT = np.array([0.0, 0.0, 1.0, 0.0, 2.0 * CLOSED - 1.0], np.float32)
_EMPTY = np.array([0.0, 0.0, 0.5, 0.0, -1.0], np.float32)  # open, and rise by 1 cm


def pick_by_touch(observation: Array, gain: float = _GAIN) -> Array:
    """Find an object by touch, and pick it up; see the module.

    Args:
        observation: Observation of `PickEnv`.
        gain: Share of an error that one action corrects before a cylinder is grasped.
            (Boxes use the default, because the steps of their tries are timed for it.)
    """
    o = observation.astype(float)
    return _sweep(o, gain) if o[9] > 0.5 else _retry(o)


TOUCH_RULES = dict.fromkeys(
    ("drake_srg/Pick-v0", "drake_srg/KitchenPick-v0"), pick_by_touch
)


def _sweep(o: Array, gain: float) -> Array:
    """Push a cylinder to a known place, and pick it up there."""
    step = _step(o)
    if step >= _LIFTED_AT and o[22] > 0.0:
        return _LIFT.copy()
    if step >= _OPENED_AT:
        return _pick_beside(o, np.array([_BEYOND - _SHORT, 0.0]), gain)
    x, y = -NEAR * o[:2]  # of the hand, from the estimate
    end = _BEYOND - _HALF_FINGER - 0.5 * SIZE * o[6]
    height = max(LOWEST, SIZE * o[8] - _PALM)
    base = straight_base_angle(0.5 * _CRADLE * SIZE * o[6])
    closure = base / SRG.full_scale
    if step < _BESIDE_AT:
        goal = -_BESIDE
        if step < _ASIDE_AT:  # the hand may still be above the object
            height = NEAR * o[5]
    elif step < _SWEPT_AT:
        goal = min(end, x + _SWEEP / _GAIN)
    elif step < _BACK_AT:
        goal = end - _BACK
    else:
        goal, height, closure = end - _BACK, grasp_height(SIZE * o[8]), _OPEN
    motion = _GAIN * np.array([goal - x, -y, height - NEAR * o[5], 0.0]) / STEP
    action = np.append(motion, 2.0 * closure - 1.0)
    return np.clip(action, -1.0, 1.0).astype(np.float32)


def _retry(o: Array) -> Array:
    """Pick up a box where it was seen, or else beside that place."""
    across = o[3] > 0.0  # the fingers close along the box's y, not its x
    width = SIZE * (o[7] if across else o[6])
    base = ANGLE * o[10:12].mean()
    closed = o[22] > 0.0 and np.abs(o[14:18]).max() < _STILL_BY_TOUCH
    if closed and base > straight_base_angle(0.5 * _NARROWER * width):
        return _EMPTY.copy()
    yaw = TURN * o[24]
    aside = 0.0
    if _step(o) >= _TRIED:
        aside = _ASIDE if _step(o) < _TRIED_AGAIN else -_ASIDE
    return _pick_beside(o, aside * np.array([np.cos(yaw), np.sin(yaw)]))


def _pick_beside(o: Array, away: Array, gain: float = _GAIN) -> Array:
    """Pick as if the estimate were shifted by `away`, (2,) [m]."""
    place = o[:2] + away / NEAR
    seen = np.append(place, o[2:]).astype(np.float32)
    return pick(seen, _STILL_BY_TOUCH, _TURN_PER_WIDTH, gain)


def _step(observation: Array) -> int:
    return round(0.5 * MAX_STEPS * (float(observation[23]) + 1.0))


RANDOM, RULE, TOUCH = "random", "rule", "touch"
# Policies without a file: those that others are compared with, and all of them.
BASELINES = (RULE, RANDOM)
BUILT_IN = (RULE, TOUCH, RANDOM)
_RULES: dict[str, Mapping[str, Act]] = {RULE: RULES, TOUCH: TOUCH_RULES}
RULE_NAMES = tuple(_RULES)


def random_policy(actions: int, seed: int) -> Act:
    """Return a policy whose actions depend on the seed alone."""
    # The environment draws its scene from `seed`, too. With the same random numbers,
    # actions would correlate with the scene.
    rng = default_rng([seed, 1])

    def act(_: Array) -> Array:
        return rng.uniform(-1.0, 1.0, actions).astype(np.float32)

    return act


def rule_of(env: Any, rule: str = RULE) -> Act:
    """Return a hand-written policy of an environment.

    Args:
        env: The environment. Your own environment may define its rule as the method
            `rule`.
        rule: `rule`, or `touch` for the one that finds objects by touch.

    Raises:
        ScenarioError: If the environment has no such rule.
    """
    name = env.spec.id if env.spec else type(env).__name__
    found = named_rule(name, rule)
    if found is None and rule == RULE:
        found = getattr(env.unwrapped, "rule", None)
    if found is None:
        which = "rule" if rule == RULE else f"rule `{rule}`"
        raise ScenarioError(f"ENV: {name}: has no hand-written {which}")
    return found


def named_rule(environment: str, rule: str) -> Act | None:
    """Return a hand-written policy of an environment of drake_srg, or None."""
    return _RULES[rule].get(environment)
