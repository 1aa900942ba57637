"""The temperature of the SRG's motor, which its current warms."""

import dataclasses as dc
import math

from pydrake.systems.framework import Context, DiscreteValues

from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.lifetime import LeafSystem
from drake_srg.types import positive


@dc.dataclass(kw_only=True)
class MotorTemperatureConfig:
    """A Dynamixel MX-64 in still air."""

    # Data sheet: current at stall and 12 V [A]. The windings then have 2.9 ohm.
    stall_current: float = dc.field(default=4.1, metadata=positive())
    supply_voltage: float = dc.field(default=12.0, metadata=positive())  # V
    ambient: float = 25.0  # degC
    # From the motor, windings and housing taken as one, to the air [K/W]: 0.0132 m²
    # (40 x 61 x 41 mm, data sheet) at 10 W/(m² K), common for free convection with
    # radiation. A fifth of the stall torque, the most that ROBOTIS recommends, then
    # warms it by 15 K.
    thermal_resistance: float = dc.field(default=7.6, metadata=positive())
    # Heat capacity [J/K]: 126 g (data sheet) of metal gears, windings and plastics at
    # 0.9 J/(g K). The time constant, 14 min, agrees with the manual, which asks to wait
    # 20 min after an alarm.
    heat_capacity: float = dc.field(default=113.0, metadata=positive())
    # Heat of the electronics, at any load [W]. It is off by default: the
    # manual's standby current of 0.1 A would be 1.2 W.
    idle_power: float = dc.field(default=0.0, metadata={"ge": 0.0})
    period: float = dc.field(default=0.1, metadata=positive())  # s

    @property
    def time_constant(self) -> float:
        """Time in which the temperature goes 63 % of its way [s]."""
        return self.thermal_resistance * self.heat_capacity


def motor_load(drive: TendonDriveConfig, pwm: float, speed: float) -> float:
    """Return the motor's torque over its stall torque; the same holds for its current.

    It is the current that the servo's own register shows. An MX-64 has no sensor for
    it, but estimates it (docs/gripper.md).

    Args:
        drive: The motor.
        pwm: Fraction of full scale, -1 .. 1.
        speed: Of the spool [rad/s].
    """
    return drive.full_scale * drive.useful_pwm(pwm) - speed / drive.no_load_speed


class MotorTemperature(LeafSystem):
    """Computes the motor's temperature: copper loss warms it, air cools it.

    .. pydrake_system::

        name: MotorTemperature
        input_ports:
        - pwm
        - motor_state
        output_ports:
        - motor_temperature

    `pwm` (1) is a fraction of full scale, and `motor_state` (2) is [angle; speed] in
    rad, rad/s. `motor_temperature` (1) [degC] starts at that of the air. The model is
    of first order, with the current I that gives the torque and the resistance R of the
    windings:

        C T' = P_idle + I² R + I U_0 - (T - T_air) / R_thermal

    U_0 is the voltage lost to the drive's dead band, if any. It is solved exactly for
    a current that is constant during `config.period`.

    Args:
        drive: The motor's torque and speed.
        config: Its thermal properties.
    """

    def __init__(
        self,
        drive: TendonDriveConfig | None = None,
        config: MotorTemperatureConfig | None = None,
    ) -> None:
        super().__init__()
        self.config = config or MotorTemperatureConfig()
        self._drive = drive or TendonDriveConfig()
        self._pwm = self.DeclareVectorInputPort(name="pwm", size=1)
        self._motor = self.DeclareVectorInputPort(name="motor_state", size=2)
        temperature = self.DeclareDiscreteState([self.config.ambient])
        self.DeclareStateOutputPort("motor_temperature", temperature)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        config = self.config
        before = context.get_discrete_state(0).value()[0]
        pwm, speed = self._pwm.Eval(context)[0], self._motor.Eval(context)[1]
        load = motor_load(self._drive, pwm, speed)
        # I² R + I U_0 with R = (U - U_0) / I_stall and I = load I_stall
        band = self._drive.dead_band
        loss = load**2 * config.stall_current * config.supply_voltage * (1.0 - band)
        loss += abs(load) * config.stall_current * config.supply_voltage * band
        loss += config.idle_power
        final = config.ambient + loss * config.thermal_resistance
        decay = math.exp(-config.period / config.time_constant)
        discrete_state.set_value([final + (before - final) * decay])
