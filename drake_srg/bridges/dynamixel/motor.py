"""The simulated motor as a servo's firmware sees it."""

from __future__ import annotations

import dataclasses as dc

from drake_srg.gripper.driver import WireMotor
from drake_srg.gripper.motor_temperature import motor_load


@dc.dataclass(frozen=True)
class MotorState:
    """What a servo senses of its motor.

    Attributes:
        angle: Of the spool [rad].
        speed: Of the spool [rad/s].
        pwm: Fraction of full scale.
        current: [A], positive where its torque winds.
        temperature: [degrees Celsius].
    """

    angle: float = 0.0
    speed: float = 0.0
    pwm: float = 0.0
    current: float = 0.0
    temperature: float = 25.0


@dc.dataclass(frozen=True)
class MotorCommand:
    """The servo's command to its motor.

    Attributes:
        position: Spool angle [rad]; NaN if `torque` applies.
        torque: Fraction of the torque at full PWM, positive to wind; NaN if `position`
            applies.
        limit: Force limit kappa, fraction of full PWM, 0 .. 1.
    """

    position: float
    torque: float
    limit: float

    def same(self, other: MotorCommand | None) -> bool:
        """Return whether two commands are equal, where NaN equals NaN."""
        return repr(self) == repr(other)


class Motor:
    """Converts between amperes and duty of a servo and fractions of full PWM.

    A duty is a fraction of the supply voltage. Full PWM, full scale of the gripper's
    commands, is a duty of `drive.full_scale`.

    Args:
        motor: The motor.
    """

    def __init__(self, motor: WireMotor):
        self._motor = motor

    @property
    def supply_voltage(self) -> float:
        """Voltage of the supply [V], which never sags."""
        return self._motor.temperature.supply_voltage

    @property
    def full_duty(self) -> float:
        """The duty of full PWM."""
        return self._motor.drive.full_scale

    def sense(
        self, angle: float, speed: float, pwm: float, temperature: float
    ) -> MotorState:
        """Return the state that the registers show, with the current that they show."""
        load = motor_load(self._motor.drive, pwm, speed)
        current = load * self._motor.temperature.stall_current
        return MotorState(angle, speed, pwm, current, temperature)

    def load(self, current: float) -> float:
        """Return the fraction of the stall torque at a current [A]."""
        return current / self._motor.temperature.stall_current

    def torque(self, current: float) -> float:
        """Return the torque at a current [A], as a fraction of that at full PWM."""
        return self.load(current) / self.full_duty

    def limit(self, duty: float) -> float:
        """Return the force limit of a duty."""
        return min(abs(duty) / self.full_duty, 1.0)

    def torque_of_duty(self, duty: float, speed: float) -> float:
        """Return the torque command that gives a duty at a speed [rad/s].

        Torque control adds duty against the back-EMF, which is taken off here.
        """
        useful = self._motor.drive.useful_pwm(duty / self.full_duty)
        return useful - self._added(speed)

    def limit_of_current(self, current: float, speed: float) -> float:
        """Return the force limit of a current [A] at a speed [rad/s].

        At rest it gives the torque of that current. Towards the goal (a positive speed)
        back-EMF takes none of it, as in torque control.
        """
        useful = self.torque(abs(current)) + self._added(speed)
        return min(max(self._motor.drive.pwm_of(useful), 0.0), 1.0)

    def _added(self, speed: float) -> float:
        drive, share = self._motor.drive, self._motor.servo.current_control
        return share * speed / (drive.no_load_speed * drive.full_scale)
