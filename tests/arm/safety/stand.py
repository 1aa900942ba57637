"""A safety monitor on its own, driven one control period at a time."""

import numpy as np
from helpers import fix, read, update

from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.arm.safety.limits import JointLimits
from drake_srg.arm.safety.monitor import SafetyMonitor
from drake_srg.common.safety_states import safety_state

PERIOD = 0.005
UPPER = np.array([1.0, 2.0])
SPEED, ACCELERATION, STOP = 1.5, 12.0, 16.0
LIMITS = JointLimits(
    lower=-UPPER,
    upper=UPPER,
    step=np.full(2, SPEED * PERIOD),
    bend=np.full(2, ACCELERATION * PERIOD**2),
    brake=np.full(2, STOP * PERIOD**2),
)


class Stand:
    """A monitor of two joints, with a record of what it allows."""

    def __init__(self, config=None, **limits):
        config = config or SafetyConfig()
        self.system = SafetyMonitor(np.zeros(2), LIMITS, config, PERIOD, **limits)
        self.context = self.system.CreateDefaultContext()
        self.ticks = 0
        self.allowed = [np.zeros(2)]
        self.fix(position_commanded=np.zeros(2))

    def fix(self, **inputs):
        fix(self.system, self.context, **inputs)

    def tick(self, q, **inputs):
        """Command joint positions for one period; return what the driver gets."""
        self.fix(position_commanded=q, **inputs)
        time = self.ticks * PERIOD
        self.context.SetTime(time)
        update(self.system, self.context, time)
        allowed = read(self.system, self.context, "position_allowed")
        self.ticks += 1
        self.allowed.append(allowed)
        return allowed

    def follow(self, commands, **inputs):
        """Command a sequence; return all that was allowed so far, shape (K, 2)."""
        for q in commands:
            self.tick(q, **inputs)
        return np.array(self.allowed)

    def rest(self, ticks=100, **inputs):
        """Repeat what is allowed until the arm rests."""
        return self.follow([self.allowed[-1]] * ticks, **inputs)

    @property
    def state(self):
        return self._state_and_reason[0]

    @property
    def reason(self):
        return self._state_and_reason[1]

    @property
    def speed_scale(self):
        return read(self.system, self.context, "speed_scale")[0]

    @property
    def _state_and_reason(self):
        return safety_state(read(self.system, self.context, "state"))


def curve(ticks, speed=1.0, first=0):
    """Return commands on a curve that starts at rest in [0, 0], shape (ticks, 2)."""
    t = np.arange(first + 1, first + ticks + 1) * PERIOD
    s = speed * np.where(t < 0.4, t * t / 0.8, t - 0.2)
    return np.stack([0.8 * np.sin(s), 1.0 - np.cos(s)], axis=-1)


def steps(allowed):
    """Return the largest step and the largest change of a step, in limits' units."""
    first = np.diff(allowed, axis=0, prepend=allowed[:1])
    second = np.diff(first, axis=0, prepend=np.zeros((1, 2)))
    return np.abs(first) / LIMITS.step, np.abs(second) / LIMITS.brake


def distance_to_line(points, line):
    """Return how far points are from a line through other points, shape (K,)."""
    a, d = line[:-1], np.diff(line, axis=0)
    length = np.maximum(np.einsum("ij,ij->i", d, d), 1e-30)
    best = []
    for p in points:
        u = np.clip(np.einsum("ij,ij->i", p - a, d) / length, 0.0, 1.0)
        best.append(np.min(np.linalg.norm(a + u[:, None] * d - p, axis=1)))
    return np.array(best)
