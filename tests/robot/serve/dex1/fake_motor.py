"""A motor without inertia whose fingers meet, or an object that they hold."""

import numpy as np

STEP = 0.005


class FakeMotor:
    """Answers a hand's commands.

    Attributes:
        meets: Angle at which the fingers stop [rad].
        temperature: [degrees Celsius].
    """

    def __init__(self, inbox, ports):
        self._inbox, self._ports = inbox, ports
        self._commands = {}
        self.angle, self.time, self.pwm = 0.0, 0.0, 0.0
        self.meets, self.temperature = 2.8, 30.0

    def step(self):
        """Return the time and the values of the station's ports after a step."""
        self._commands.update(self._inbox.take())
        values = {k.split(".")[1]: v[0] for k, v in self._commands.items()}
        limit = values.get("force_limit", 1.0)
        pull = 5.0 * (values.get("motor_position_commanded", self.angle) - self.angle)
        self.pwm = float(np.clip(np.nan_to_num(pull), -limit, limit))
        moved = min(self.angle + STEP * 10.0 * self.pwm, self.meets)
        speed, self.angle = (moved - self.angle) / STEP, moved
        self.time += STEP
        values = [self.angle, speed], [self.pwm], [self.temperature]
        return self.time, dict(zip(self._ports, map(np.array, values), strict=True))
