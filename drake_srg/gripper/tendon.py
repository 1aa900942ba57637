"""The SRG's drive: a motor that winds a wire per finger, friction, temperature."""

import dataclasses as dc
import math
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    ValueProducer,
)

from drake_srg.common.exceptions import ScenarioError
from drake_srg.config import Config, positive
from drake_srg.gripper.underactuation import FINGERS
from drake_srg.lifetime import LeafSystem, weak
from drake_srg.types import Vector

# Coefficients of the moment arms, lowest power first [m, m/rad, ...].
# tools/fit_moment_arms.py fits them to SAKE's public MuJoCo model
# (experiments/data/tendon_moment_arms.csv), within 0.02 % (base, up to 2.007 rad) and
# 0.05 % (tip, up to 1.745 rad). The base's arm depends only on the base angle, the
# tip's only on the tip angle.
_BASE = (
    *(6.482929e-3, 7.294326e-3, -3.261617e-4, -2.293250e-3),
    *(3.144639e-3, -2.975419e-3, 1.379180e-3, -2.771902e-4),
)
_TIP = (4.628336e-3, -2.780686e-5, -5.128206e-4, -1.948426e-4, 3.614142e-5)
_BASE_TRAVEL = (0.0, *(c / (i + 1) for i, c in enumerate(_BASE)))
_TIP_TRAVEL = (0.0, *(c / (i + 1) for i, c in enumerate(_TIP)))


def base_moment_arm(base: Any) -> Any:
    """Return the wire's arm about the base hinge [m] at a base angle [rad]."""
    return _polynomial(_BASE, base)


def tip_moment_arm(tip: Any) -> Any:
    """Return the wire's arm about the tip hinge [m] at a tip angle [rad]."""
    return _polynomial(_TIP, tip)


def wire_travel(base: Any, tip: Any) -> Any:
    """Return the wire length that moves a finger from open to given angles [m].

    It is the integral of the moment arms, so the wire's work equals the joints' work.

    Args:
        base: Base angle [rad].
        tip: Tip angle [rad].
    """
    return _polynomial(_BASE_TRAVEL, base) + _polynomial(_TIP_TRAVEL, tip)


def empty_hand(
    closure: float, full_scale: float, base_limit: float
) -> tuple[float, Vector]:
    """Return the wire travel [m] and the joints [rad] of an empty SRG at a closure.

    The base moves to its limit first, and then the tip, as in Algorithm 1.

    Args:
        closure: 0 open .. 1 closed, clipped.
        full_scale: Base plus tip angle at closure 1 [rad].
        base_limit: Limit of the base, beyond which the tip closes [rad].
    """
    total = full_scale * min(max(closure, 0.0), 1.0)
    base = min(total, base_limit)
    tip = total - base
    return float(wire_travel(base, tip)), np.array([base, base, tip, tip])


def _polynomial(coefficients: tuple[float, ...], x: Any) -> Any:
    value: Any = 0.0
    for c in coefficients[::-1]:
        value = value * x + c
    return value


# Travel after which a wire that reverses slides on its guides [m]: the stretch, about
# 1 %, of the 10 mm of wire in the guides.
WIRE_PRESLIDING = 1e-4


@dc.dataclass(kw_only=True)
class DriveFrictionConfig(Config):
    """Friction of gears and wires. Off by default: no data sheet states a value."""

    # Friction of the gear train at the spool: a constant part [N m], and a part
    # proportional to the wires' torque, due to tooth forces (at 1, the load cannot turn
    # the motor back). The motor's stall torque does not include this friction.
    gear: float = dc.field(default=0.0, metadata={"ge": 0.0})
    gear_load: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 1.0})
    # Friction of a resting spool, over that of a moving one: 1.2 to 1.5 for lubricated
    # steel gears.
    stiction: float = dc.field(default=1.0, metadata={"ge": 1.0, "le": 3.0})
    # Capstan friction of a wire on its guides: coefficient times angle of wrap [rad].
    # The force at the finger is exp(-wire) times that at the spool while the wire winds
    # in, and exp(wire) times while it pays out.
    wire: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 1.0})

    def gear_torque(self, load: float) -> float:
        """Return the friction torque of the moving gears at a load, both in N m."""
        return self.gear + self.gear_load * load

    def motor_torque(self, load: float) -> float:
        """Return the torque that winds the spool against a load [N m]."""
        return load + self.gear_torque(load)

    def load(self, motor_torque: float) -> float:
        """Return the load against which a motor torque just winds [N m]."""
        return (motor_torque - self.gear) / (1.0 + self.gear_load)


def reduce_magnitude(value: float, most: float) -> float:
    """Return a value moved towards 0 by at most `most`, as Coulomb friction does.

    Args:
        value: For example, a speed without friction [rad/s].
        most: For example, the largest change of speed by friction in a step [rad/s].
    """
    return max(value - most, 0.0) + min(value + most, 0.0)


def apply_stiction(before: float, speed: float, most: float, after: float) -> float:
    """Return the speed with friction, which is 0 while stiction holds the spool.

    Args:
        before: Speed before the step [rad/s].
        speed: Speed after the step, without friction [rad/s].
        most: Largest change of speed that stiction resists in this step [rad/s].
        after: Speed after the step, with the friction of a moving spool [rad/s].
    """
    return 0.0 if before == 0.0 and abs(speed) <= most else after


def wire_slip(state: float, travel: float, presliding: float) -> float:
    """Return the state of a wire's friction: -1 sliding out .. 1 sliding in.

    Args:
        state: State before the travel, -1 .. 1.
        travel: Travel of the wire along its guides towards the spool [m].
        presliding: Travel from no friction to sliding [m].
    """
    return max(-1.0, min(1.0, state + travel / presliding))


def transmitted_share(state: float, friction: float) -> float:
    """Return the share of the spool's pull that reaches the finger.

    Args:
        state: State of the friction, from `wire_slip`.
        friction: Coefficient times angle of wrap [rad].
    """
    return math.exp(-friction * state)


@dc.dataclass(kw_only=True)
class TorsionSpringConfig(Config):
    """A spring in a hinge that opens the finger."""

    # Torque at 0 rad, with the finger open and straight [N m].
    preload: float = dc.field(metadata={"ge": 0.0})
    stiffness: float = dc.field(metadata={"ge": 0.0})  # N m / rad


@dc.dataclass(kw_only=True)
class TendonDriveConfig(Config):
    """Motor, wires and springs. The defaults are the SRG's with a Dynamixel MX-64."""

    # Data sheet of the MX-64, at 12 V: stall torque [N m] and no-load speed [rad/s].
    stall_torque: float = dc.field(default=6.0, metadata=positive())
    no_load_speed: float = dc.field(default=6.6, metadata=positive())
    # Share of both at full PWM: SAKE's driver libezgripper uses 800 of 1023.
    full_scale: float = dc.field(default=800 / 1023, metadata=positive(le=1.0))
    # Share of the PWM lost in bridge and brushes. Up to it, the motor gives no torque.
    # Beyond it, the torque at rest grows linearly, to `stall_torque` at a PWM of 1. No
    # data sheet states a value.
    dead_band: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 0.5})
    # Time constant of the servo's own torque control [s]; 0: no delay. In this time,
    # the PWM changes by the torque's error, both as shares of full scale. See
    # `TorqueControl`.
    torque_rise: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Inertia at the spool [kg m²]: 200² times the rotor's inertia, which is not
    # published. A coreless motor of this size (21 mm) has about 2.5e-7 kg m².
    reflected_inertia: float = dc.field(default=0.01, metadata=positive())
    # Radius of the spool [m]: it winds 29.1 mm of wire in 2500 encoder counts, of 4096
    # per turn.
    spool_radius: float = dc.field(default=0.0076, metadata=positive())
    # Stiffness [N/m] of 0.2 m of braided polyethylene line, 0.8 mm thick, at 10 GPa.
    # The damping [N s/m] is a tenth of critical for the finger that it pulls (1.2 kg
    # seen from the wire).
    wire_stiffness: float = dc.field(default=2.5e4, metadata=positive())
    wire_damping: float = dc.field(default=35.0, metadata={"ge": 0.0})
    friction: DriveFrictionConfig = dc.field(default_factory=DriveFrictionConfig)
    # From SAKE's public MuJoCo model of 2026, "from actual spring specs": stiffness,
    # and preload relative to -2.09 rad, where open is -pi/2 (base) and 0 (tip).
    base_spring: TorsionSpringConfig = dc.field(
        default_factory=lambda: TorsionSpringConfig(preload=0.00308, stiffness=0.00593)
    )
    tip_spring: TorsionSpringConfig = dc.field(
        default_factory=lambda: TorsionSpringConfig(preload=0.01611, stiffness=0.00771)
    )
    # Damping of each hinge [N m s/rad]: critical for a finger on its base spring, so
    # the finger opens as fast as possible without ringing.
    joint_damping: float = dc.field(default=0.0022, metadata={"ge": 0.0})

    @property
    def full_torque(self) -> float:
        """Motor torque at rest at full PWM [N m]."""
        return self.full_scale * self.stall_torque

    @property
    def motor_damping(self) -> float:
        """Torque that the motor loses per speed, to back-EMF [N m s/rad]."""
        return self.stall_torque / self.no_load_speed

    @property
    def full_wire_force(self) -> float:
        """Force of each wire when both balance the motor, at rest at full PWM [N].

        With friction in the gears, it is the force that the motor reaches as it winds
        the spool.
        """
        return self.wire_force_of(1.0)

    def wire_force_of(self, force_limit: float) -> float:
        """Return the force of each wire that a servo's `force_limit` allows [N]."""
        torque = self.friction.load(self.full_torque * self.useful_pwm(force_limit))
        return max(torque, 0.0) / (2.0 * self.spool_radius)

    def useful_pwm(self, pwm: float) -> float:
        """Return the PWM that a motor without dead band needs for the same torque.

        Args:
            pwm: Fraction of full scale, -1 .. 1.
        """
        if self.dead_band == 0.0:
            return pwm
        band = self.dead_band / self.full_scale
        return reduce_magnitude(pwm, band) / (1.0 - self.dead_band)

    def pwm_of(self, useful: float) -> float:
        """Return the PWM that `useful_pwm` maps to a value above 0."""
        return useful * (1.0 - self.dead_band) + self.dead_band / self.full_scale

    def force_limit_of(self, wire_force: float) -> float:
        """Return the servo's `force_limit` that pulls each wire with this force [N].

        Raises:
            ScenarioError: If the servo cannot pull that hard, or the force is negative.
        """
        if not 0.0 <= wire_force <= self.full_wire_force:
            raise ScenarioError(
                f"wire force {wire_force:g} N: the servo gives 0 .. "
                f"{self.full_wire_force:.0f} N at each wire"
            )
        torque = self.friction.motor_torque(2.0 * self.spool_radius * wire_force)
        if self.dead_band == 0.0 and torque == 2.0 * self.spool_radius * wire_force:
            return wire_force / self.full_wire_force
        return min(self.pwm_of(torque / self.full_torque), 1.0)


class TendonDrive(LeafSystem):
    """Turns PWM into four joint torques by motor, spool, wires and springs.

    .. pydrake_system::

        name: TendonDrive
        input_ports:
        - pwm
        - state_measured
        output_ports:
        - joint_torque
        - motor_state
        - taut_state
        - wire_force

    `pwm` (1) is a fraction of full scale, clipped to -1 .. 1. `state_measured` (8)
    is [q; v] of the finger joints in rad, rad/s. Joints, also of `joint_torque` (4)
    [N m], are ordered left base, right base, left tip, right tip. `motor_state` (2)
    is [angle; speed] of the spool in rad, rad/s; the angle is 0 where the wires are
    taut with the fingers open. `taut_state` (2) is the state of a spool at rest
    whose wires are just taut (only one of them if the fingers' positions differ). A
    simulation starts in this state. `wire_force` (2) [N] holds the forces of the
    left and the right wire.

    The motor is a DC motor, so limiting the PWM limits its torque at rest:

        J w' = tau_stall (scale pwm - w / w_0) - r_spool (F_left + F_right)

    A wire only pulls, stretched by x = r_spool angle - (travel of the finger):

        F = max(0, k x + c x')

    Each joint gets F times its moment arm, minus its spring's torque. Springs, arms
    and contact alone decide which joint of a finger moves first.

    Two effects are off by default. With `dead_band`, the motor loses part of its
    PWM (see `useful_pwm`). With `friction`, the gears slow or hold the spool, and
    the joints get less than F while the wire winds in and more while it pays out
    (see `DriveFrictionConfig`). `wire_force` is still the force at the spool.

    The motor's state is updated every `period` [s] (the plant's step). The update
    is implicit in the back-EMF, whose time constant J w_0 / tau_stall, 11 ms, is
    shorter than some steps.
    """

    def __init__(self, config: TendonDriveConfig, period: float) -> None:
        super().__init__()
        self.config = config
        self._period = period
        self._pwm = self.DeclareVectorInputPort(name="pwm", size=1)
        self._measured = self.DeclareVectorInputPort(name="state_measured", size=8)
        # Spool angle and speed, and the friction of each wire, -1 .. 1.
        self.DeclareDiscreteState(4 if config.friction.wire else 2)
        # In each step, both the joints and the motor need the wires.
        entry = self.DeclareCacheEntry(
            description="wires",
            value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make(object()),
                calc=weak(self._calc_wires),
            ),
            prerequisites_of_calc={self.xd_ticket(), self._measured.ticket()},
        )
        # Its index, because a wrapper of the entry would keep the system alive.
        self._wires_index = entry.cache_index()
        moving = {self.xd_ticket(), self._measured.ticket()}
        for name, size, calc, prerequisites in (
            ("joint_torque", 4, self._calc_joint_torque, moving),
            ("motor_state", 2, self._calc_motor_state, {self.xd_ticket()}),
            ("taut_state", 2, self._calc_taut_state, {self._measured.ticket()}),
            ("wire_force", 2, self._calc_wire_force, {entry.ticket()}),
        ):
            self.DeclareVectorOutputPort(
                name=name,
                size=size,
                calc=calc,
                prerequisites_of_calc=prerequisites,
            )
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _wires(self, context: Context) -> list[tuple[float, float, float]]:
        """Return the force of each wire, and its moment arms at base and tip."""
        entry = self.get_cache_entry(self._wires_index)
        wires: list[tuple[float, float, float]]
        wires = entry.EvalAbstract(context).get_value()
        return wires

    def _calc_wires(self, context: Context, output: AbstractValue) -> None:
        config, state = self.config, self._measured.Eval(context).tolist()
        angle, speed, *_ = context.get_discrete_state(0).CopyToVector().tolist()
        wires = []
        for base, tip in FINGERS:
            base_arm = base_moment_arm(state[base])
            tip_arm = tip_moment_arm(state[tip])
            stretch = config.spool_radius * angle - wire_travel(state[base], state[tip])
            rate = (
                config.spool_radius * speed
                - base_arm * state[4 + base]
                - tip_arm * state[4 + tip]
            )
            pull = config.wire_stiffness * stretch + config.wire_damping * rate
            wires.append((max(pull, 0.0), base_arm, tip_arm))
        output.set_value(wires)

    def _calc_joint_torque(self, context: Context, output: BasicVector) -> None:
        config, state = self.config, self._measured.Eval(context).tolist()
        torques = [0.0] * 4
        _, _, *stuck = context.get_discrete_state(0).CopyToVector().tolist()
        wires = self._wires(context)
        if stuck:
            wires = [
                (force * transmitted_share(s, config.friction.wire), base_arm, tip_arm)
                for s, (force, base_arm, tip_arm) in zip(stuck, wires, strict=True)
            ]
        for (base, tip), (force, base_arm, tip_arm) in zip(FINGERS, wires, strict=True):
            for joint, arm, spring in (
                (base, base_arm, config.base_spring),
                (tip, tip_arm, config.tip_spring),
            ):
                back = spring.preload + spring.stiffness * state[joint]
                torques[joint] = force * arm - back
        output.SetFromVector(torques)

    def _calc_motor_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(0).CopyToVector()[:2])

    def _calc_taut_state(self, context: Context, output: BasicVector) -> None:
        state = self._measured.Eval(context).tolist()
        travel = min(wire_travel(state[base], state[tip]) for base, tip in FINGERS)
        output.SetFromVector([travel / self.config.spool_radius, 0.0])

    def _calc_wire_force(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([force for force, *_ in self._wires(context)])

    def _initialize(self, context: Context, discrete_state: DiscreteValues) -> None:
        state = context.get_discrete_state(0).CopyToVector()
        state[:2] = self.GetOutputPort("taut_state").Eval(context)
        discrete_state.set_value(state)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        config, dt = self.config, self._period
        state = self._measured.Eval(context).tolist()
        angle, speed, *stuck = context.get_discrete_state(0).CopyToVector().tolist()
        wires = self._wires(context)
        load = config.spool_radius * sum(force for force, *_ in wires)
        pwm = min(max(self._pwm.Eval(context)[0], -1.0), 1.0)
        torque = config.full_torque * config.useful_pwm(pwm)
        inertia, damping = config.reflected_inertia, config.motor_damping
        friction = config.friction
        before, total = speed, inertia + dt * damping
        speed = (inertia * before + dt * (torque - load)) / total
        if friction.gear or friction.gear_load:
            most = dt * friction.gear_torque(load) / total
            after = reduce_magnitude(speed, most)
            if friction.stiction > 1.0:
                after = apply_stiction(before, speed, friction.stiction * most, after)
            speed = after
        motion = [angle + dt * speed, speed]
        for s, (base, tip), (_, base_arm, tip_arm) in zip(
            stuck, FINGERS, wires, strict=False
        ):
            rate = base_arm * state[4 + base] + tip_arm * state[4 + tip]
            motion.append(wire_slip(s, dt * rate, WIRE_PRESLIDING))
        discrete_state.set_value(motion)


@dc.dataclass(kw_only=True)
class MotorTemperatureConfig(Config):
    """A Dynamixel MX-64 in still air."""

    # Data sheet: current at stall and 12 V [A]. The windings then have 2.9 ohm.
    stall_current: float = dc.field(default=4.1, metadata=positive())
    supply_voltage: float = dc.field(default=12.0, metadata=positive())  # V
    ambient: float = 25.0  # degC
    # From the motor (windings and housing as one body) to the air [K/W]: 0.0132 m² (40
    # x 61 x 41 mm, data sheet) at 10 W/(m² K), common for free convection with
    # radiation. A fifth of the stall torque, the most that ROBOTIS recommends, then
    # warms the motor by 15 K.
    thermal_resistance: float = dc.field(default=7.6, metadata=positive())
    # Heat capacity [J/K]: 126 g (data sheet) of metal gears, windings and plastics at
    # 0.9 J/(g K). The time constant, 14 min, agrees with the manual, which asks to wait
    # 20 min after an alarm.
    heat_capacity: float = dc.field(default=113.0, metadata=positive())
    # Heat of the electronics, at any load [W]; off by default. The manual's standby
    # current of 0.1 A would give 1.2 W.
    idle_power: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Time constant with which the windings' heat reaches the housing and its sensor
    # [s]; 0: no delay. Makers of such motors state about 10 s.
    winding_time: float = dc.field(default=0.0, metadata={"ge": 0.0})
    period: float = dc.field(default=0.1, metadata=positive())  # s

    @property
    def time_constant(self) -> float:
        """Time in which the temperature makes 63 % of a change [s]."""
        return self.thermal_resistance * self.heat_capacity


def motor_load(drive: TendonDriveConfig, pwm: float, speed: float) -> float:
    """Return the motor's torque over its stall torque, which is also its current ratio.

    The servo's register shows the current. An MX-64 does not measure but estimates it
    (docs/gripper.md).

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
    temperature, without heat flow. With the motor's current I and the resistance R of
    the windings:

        P = P_idle + I² R + I U_0
        t_winding Q' = P - Q
        C T' = Q - (T - T_air) / R_thermal

    U_0 is the voltage lost to the drive's dead band, if any. The current is taken as
    constant during `config.period`; T integrates the mean of the heat flow Q.
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
