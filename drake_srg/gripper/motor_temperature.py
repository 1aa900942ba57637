"""The temperature of the SRG's motor, from the heat that its current makes."""

import dataclasses as dc
import math

from pydrake.systems.framework import Context, DiscreteValues

from drake_srg.config import Config, positive
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.lifetime import LeafSystem


@dc.dataclass(kw_only=True)
class MotorTemperatureConfig(Config):
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
    # Time constant with which the windings' heat reaches the housing and its sensor
    # [s]; 0: at once. Makers of such motors state about 10 s.
    winding_time: float = dc.field(default=0.0, metadata={"ge": 0.0})
    period: float = dc.field(default=0.1, metadata=positive())  # s

    @property
    def time_constant(self) -> float:
        """Time in which the temperature makes 63 % of a change [s]."""
        return self.thermal_resistance * self.heat_capacity


def motor_load(drive: TendonDriveConfig, pwm: float, speed: float) -> float:
    """Return the motor's torque over its stall torque; the same holds for its current.

    The servo's register shows this current. An MX-64 does not measure it, but estimates
    it (docs/gripper.md).

    Args:
        drive: The motor.
        pwm: Fraction of full scale, -1 .. 1.
        speed: Speed of the spool [rad/s].
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

    `pwm` (1) is a fraction of full scale, clipped to -1 .. 1, and `motor_state` (2) is
    [angle; speed] in rad, rad/s. `motor_temperature` (1) [degC] starts at the air's
    temperature, without heat flow. With the current I that gives the torque and the
    resistance R of the windings:

        P = P_idle + I² R + I U_0
        t_winding Q' = P - Q
        C T' = Q - (T - T_air) / R_thermal

    U_0 is the voltage lost to the drive's dead band, if any. The current is taken as
    constant during `config.period`; T integrates the mean of the heat flow Q.

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
        if self.config.winding_time:
            self.DeclareDiscreteState([0.0])  # heat flow into the housing [W]
        self.DeclareStateOutputPort("motor_temperature", temperature)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        config = self.config
        before = context.get_discrete_state(0).value()[0]
        pwm = min(max(self._pwm.Eval(context)[0], -1.0), 1.0)
        speed = self._motor.Eval(context)[1]
        flow = self.heat(motor_load(self._drive, pwm, speed))
        if config.winding_time:
            old = context.get_discrete_state(1).value()[0]
            kept = math.exp(-config.period / config.winding_time)
            discrete_state.set_value(1, [flow + (old - flow) * kept])
            flow += (old - flow) * (1.0 - kept) * config.winding_time / config.period
        final = config.ambient + flow * config.thermal_resistance
        decay = math.exp(-config.period / config.time_constant)
        discrete_state.set_value(0, [final + (before - final) * decay])

    def heat(self, load: float) -> float:
        """Return the heat of the motor [W] at a load, see `motor_load`."""
        config, band = self.config, self._drive.dead_band
        # I² R + I U_0 with R = (U - U_0) / I_stall and I = load I_stall
        loss = load**2 * config.stall_current * config.supply_voltage * (1.0 - band)
        loss += abs(load) * config.stall_current * config.supply_voltage * band
        return loss + config.idle_power
