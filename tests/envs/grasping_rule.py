"""A hand-written rule for Pick: over the object, down, close, up."""

import numpy as np

DOWN, CLOSING = 4.0e-3, 14  # when it is over the object [m]; periods that closing takes


class Rule:
    def __init__(self, env):
        self.env, self.closing = env, 0

    def action(self):
        env = self.env
        size, estimate = env.scene.shape.bounding_size, env.estimate
        across = 0.0 if env.scene.is_round or size[1] <= size[0] else 0.5 * np.pi
        turn = (estimate[3] + across - env.pose[3] + 0.5 * np.pi) % np.pi - 0.5 * np.pi
        turn *= not env.scene.is_round
        away = estimate[:2] - env.pose[:2]
        low = env.table + max(0.03, size[2] - 0.05) - env.pose[2]
        if self.closing:
            self.closing += 1
            return np.array([0.0, 0.0, float(self.closing > CLOSING), 0.0, 0.6])
        over = np.linalg.norm(away) < DOWN and abs(turn) < 0.05
        self.closing = int(over and abs(low) < DOWN)
        steps = [*(away / 0.02), low / 0.02 * over, turn / 0.1, -1.0]
        return np.clip(steps, -1.0, 1.0)


def pick(env, seed=None, options=None):
    """Play an episode by the rule; the last info, and everything that was seen."""
    observation, info = env.reset(seed=seed, options=options)
    seen, rule, over = [observation], Rule(env), False
    while not over:
        observation, reward, terminated, truncated, last = env.step(rule.action())
        seen.append(np.append(observation, reward))
        over = terminated or truncated
    return {**info, **last}, seen
