"""Plays episodes by hand-written rules."""

import numpy as np

OVER, TURNED = 4e-3, 0.05  # over the object: within this distance [m] and angle [rad]
CLOSING = 14  # control periods that closing takes
STEP = np.array([0.02, 0.02, 0.02, 0.1])  # of a full action [m, rad]


def across(env):
    """The yaw, from the object's, across its narrower side [rad]."""
    size = env.scene.shape.bounding_size
    return 0.0 if env.scene.is_round or size[1] <= size[0] else 0.5 * np.pi


def height(env):
    """How high above the table to grasp [m]."""
    return max(0.03, env.scene.shape.bounding_size[2] - 0.05)


def one_shot(env):
    """The action that grasps the object where it was estimated."""
    z = 2.0 * (height(env) - 0.025) / 0.09 - 1.0
    return np.array([0.0, 0.0, z, across(env) / (0.5 * np.pi), -1.0, 0.6])


class Rule:
    """Over the object, down, close, up."""

    def __init__(self, env):
        self.env, self.closing = env, 0

    def action(self):
        env = self.env
        if self.closing:
            self.closing += 1
            return np.array([0.0, 0.0, float(self.closing > CLOSING), 0.0, 0.6])
        turn = env.estimate[3] + across(env) - env.pose[3]
        turn = (turn + 0.5 * np.pi) % np.pi - 0.5 * np.pi
        turn *= not env.scene.is_round
        away = env.estimate[:2] - env.pose[:2]
        down = env.table + height(env) - env.pose[2]
        over = np.linalg.norm(away) < OVER and abs(turn) < TURNED
        self.closing = int(over and abs(down) < OVER)
        return np.clip([*np.array([*away, down * over, turn]) / STEP, -1.0], -1, 1)


def play(env, seed=None, options=None):
    """Play an episode; the first and last info together, and all that was seen."""
    observation, info = env.reset(seed=seed, options=options)
    seen, rule, over = [observation], Rule(env), False
    while not over:
        observation, reward, terminated, truncated, last = env.step(rule.action())
        seen.append(np.append(observation, reward))
        over = terminated or truncated
    return {**info, **last}, seen
