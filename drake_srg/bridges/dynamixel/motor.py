"""Simulated motors as their servos' firmware sees them."""

from __future__ import annotations

import dataclasses as dc

from drake_srg.bridges.dynamixel.encoder import SPOOL, Encoder
from drake_srg.gripper.driver import WireMotor
from drake_srg.gripper.motor_temperature import motor_load


@dc.dataclass(frozen=True)
class MotorState:
    """What a servo senses of its motor.

    Attributes:
        angle: Of the output shaft, positive clockwise [rad].
        speed: Of the output shaft [rad/s].
        pwm: Fraction of full scale.
        current: [A], positive where its torque is clockwise.
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
        position: Angle of the output shaft [rad]; NaN if `torque` applies.
        torque: Fraction of the torque at full PWM, positive clockwise; NaN if
            `position` applies.
        limit: Force limit kappa, fraction of full PWM, 0 .. 1.
    """

    position: float
    torque: float
    limit: float

    def same(self, other: MotorCommand | None) -> bool:
        """Return whether two commands are equal, where NaN equals NaN."""
        return repr(self) == repr(other)


class Motor:
    """A motor that turns a joint, as its servo's firmware sees it.

    It converts between amperes and duty of a servo and fractions of full PWM. A duty is
    a fraction of the supply voltage. Full PWM is what the mechanism calls full scale.

    Args:
        encoder: Its encoder.
        supply_voltage: Voltage of the supply, which never sags [V].
        stall_current: [A].
        full_duty: The duty of full PWM.

    Attributes:
        encoder: Its encoder.
        supply_voltage: [V].
        full_duty: The duty of full PWM.
    """

    def __init__(
        self,
        encoder: Encoder,
        supply_voltage: float = 12.0,
        stall_current: float = 4.1,
        full_duty: float = 1.0,
    ):
        self.encoder = encoder
        self.supply_voltage = supply_voltage
        self.full_duty = full_duty
        self._stall_current = stall_current

    def sense(
        self, angle: float, speed: float, pwm: float, temperature: float
    ) -> MotorState:
        """Return the state that the registers show, with the current that they show."""
        current = self._load_at(pwm, speed) * self._stall_current
        return MotorState(angle, speed, pwm, current, temperature)

    def load(self, current: float) -> float:
        """Return the fraction of the stall torque at a current [A]."""
        return current / self._stall_current

    def torque(self, current: float) -> float:
        """Return the torque at a current [A], as a fraction of that at full PWM."""
        return self.load(current) / self.full_duty

    def limit(self, duty: float) -> float:
        """Return the force limit of a duty."""
        return min(abs(duty) / self.full_duty, 1.0)

    def torque_of_duty(self, duty: float, speed: float) -> float:
        """Return the torque command that gives a duty at a speed [rad/s]."""
        return duty / self.full_duty

    def limit_of_current(self, current: float, speed: float) -> float:
        """Return the force limit of a current [A] at a speed [rad/s].

        At rest it gives the torque of that current.
        """
        return min(self.torque(abs(current)), 1.0)

    def _load_at(self, pwm: float, speed: float) -> float:
        """Return the torque over the stall torque at a PWM and a speed [rad/s]."""
        return pwm * self.full_duty


class SpoolMotor(Motor):
    """The motor that winds the SRG's wires.

    Args:
        motor: The gripper's motor.
    """

    def __init__(self, motor: WireMotor):
        heat = motor.temperature
        super().__init__(
            SPOOL, heat.supply_voltage, heat.stall_current, motor.drive.full_scale
        )
        self._drive, self._servo = motor.drive, motor.servo

    def torque_of_duty(self, duty: float, speed: float) -> float:
        """See `Motor`.

        Torque control adds duty against the back-EMF, which is taken off here.
        """
        useful = self._drive.useful_pwm(duty / self.full_duty)
        return useful - self._added(speed)

    def limit_of_current(self, current: float, speed: float) -> float:
        """See `Motor`.

        Towards the goal (a positive speed) back-EMF takes none of the limit, as in
        torque control.
        """
        useful = self.torque(abs(current)) + self._added(speed)
        return min(max(self._drive.pwm_of(useful), 0.0), 1.0)

    def _load_at(self, pwm: float, speed: float) -> float:
        return motor_load(self._drive, pwm, speed)

    def _added(self, speed: float) -> float:
        drive = self._drive
        return (
            self._servo.current_control
            * speed
            / (drive.no_load_speed * drive.full_scale)
        )
