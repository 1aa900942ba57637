"""Imperfections of real joints: latency, backlash, sensor offset and noise."""

import dataclasses as dc
import math
import zlib

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    InputPort,
    OutputPort,
)

from drake_srg.common.systems import value_or_none
from drake_srg.config import Config
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

# Speeds are computed as differences of angles over this time [s].
VELOCITY_WINDOW = 0.05


@dc.dataclass(kw_only=True)
class JointErrorsConfig(Config):
    """Imperfections of a drive and its encoders. At 0, each has no effect."""

    # Delay from a command to its effect [s], rounded up to whole driver periods.
    latency: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 1.0})
    # Standard deviation of measured angles [rad]. For a 12-bit encoder, rounding alone
    # gives 2 pi / 4096 / sqrt(12) = 4.4e-4.
    encoder_noise: float = dc.field(default=0.0, metadata={"ge": 0.0})


@dc.dataclass(kw_only=True)
class ArmErrorsConfig(JointErrorsConfig):
    """Imperfections of an arm's joints, including gears and torque sensors."""

    # Play from one flank of a gear to the other, at the joint [rad]. Friction holds the
    # joint, so after a reversal, motor and encoder turn by this much before it follows.
    backlash: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Constant offset of sensed joint torques, and standard deviation of their noise, as
    # shares of the joint's effort limit. The iiwa's axis-specific torque accuracy is
    # 2 % (KUKA, LBR iiwa, technical data).
    torque_offset: float = dc.field(default=0.0, metadata={"ge": -1.0, "le": 1.0})
    torque_noise: float = dc.field(default=0.0, metadata={"ge": 0.0})


class CommandErrors(LeafSystem):
    """Delays n joint commands and models the backlash of their gears.

    .. pydrake_system::

        name: CommandErrors
        input_ports:
        - commanded
        output_ports:
        - delayed
        - play

    `commanded` (n) is sampled every `period`. Let u be the sample of `latency` ago, on
    the motors' side of the gears. `delayed` (n) is y, the position on the joints' side.
    With backlash b, y follows u only as far as `|u - y| <= b / 2` demands. This is the
    play operator for a load held by friction (G. Tao and P. Kokotovic, Adaptive Control
    of Systems with Actuator and Sensor Nonlinearities, 1996). `play` (n) is u - y.

    Args:
        size: Number of joints n.
        latency: Delay, rounded up to whole periods [s].
        backlash: Play b of the gears [rad].
        period: Time between samples [s].
    """

    def __init__(
        self, size: int, latency: float, backlash: float, period: float
    ) -> None:
        super().__init__()
        self._n, self._half = size, 0.5 * backlash
        # An excess of up to a millionth of a period is a rounding error.
        steps = math.ceil(latency / period - 1e-6)
        self._commanded = self.DeclareVectorInputPort(name="commanded", size=size)
        # Rows of n: commands from `steps` periods ago to now; and y.
        self._commands = self.DeclareDiscreteState(size * (steps + 1))
        self._y = self.DeclareDiscreteState(size)
        self.DeclareStateOutputPort("delayed", self._y)
        self.DeclareVectorOutputPort(
            name="play",
            size=size,
            calc=self._calc_play,
            prerequisites_of_calc={self.xd_ticket()},
        )
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _initialize(self, context: Context, discrete_state: DiscreteValues) -> None:
        commanded = self._commanded.Eval(context)
        for index in (self._commands, self._y):
            rows = context.get_discrete_state(index).size() // self._n
            discrete_state.set_value(index, np.tile(commanded, rows))

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        n, commanded = self._n, self._commanded.Eval(context)
        before, y = self._state(context)
        commands = np.concatenate([before[n:], commanded])
        u = commands[:n]
        discrete_state.set_value(self._commands, commands)
        y = np.clip(y, u - self._half, u + self._half)
        discrete_state.set_value(self._y, y)

    def _calc_play(self, context: Context, output: BasicVector) -> None:
        commands, y = self._state(context)
        output.SetFromVector(commands[: self._n] - y)

    def _state(self, context: Context) -> tuple[Vector, Vector]:
        """Return the commands, oldest first, and y."""
        return (
            context.get_discrete_state(self._commands).value(),
            context.get_discrete_state(self._y).value(),
        )


class _NoisyReadings(LeafSystem):
    """Base class of systems that draw normal noise with an offset, once per period.

    Seed and time alone determine the noise, so the context holds all state.
    """

    def __init__(
        self, offset: Vector, sigma: Vector, period: float, stream: tuple[int, str]
    ) -> None:
        super().__init__()
        self._offset, self._sigma, self._period = offset, sigma, period
        seed, name = stream
        self._stream = [seed, zlib.crc32(name.encode())]
        self.DeclareDiscreteState(offset)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        step = round(context.get_time() / self._period)
        generator = np.random.default_rng([*self._stream, step])
        noise = self._sigma * generator.standard_normal(len(self._sigma))
        discrete_state.set_value(self._offset + noise)


class EncoderErrors(_NoisyReadings):
    """Turns true joint states into readings of encoders on the motors' side.

    .. pydrake_system::

        name: EncoderErrors
        input_ports:
        - state
        - play (optional)
        output_ports:
        - state_measured

    `state` (2n) is the joints' [q; v], and `play` (n) is how far the motors are ahead
    of the joints. `state_measured` (2n) is [q + play; v] with normal noise.

    Args:
        size: Number of joints n.
        config: Standard deviation of the noise.
        period: Time between draws of the noise [s].
        seed: The scenario's random seed.
        name: Distinguishes the random streams of one scenario.
    """

    def __init__(
        self, size: int, config: JointErrorsConfig, period: float, seed: int, name: str
    ) -> None:
        sigma = config.encoder_noise
        speed_sigma = math.sqrt(2.0) * sigma / VELOCITY_WINDOW
        sigmas = np.repeat([sigma, speed_sigma], size)
        super().__init__(np.zeros(2 * size), sigmas, period, (seed, name))
        self._n = size
        self._sensed = self.DeclareVectorInputPort(name="state", size=2 * size)
        self._play = self.DeclareVectorInputPort(name="play", size=size)
        self.DeclareVectorOutputPort(
            name="state_measured",
            size=2 * size,
            calc=self._calc_state_measured,
            prerequisites_of_calc={self.xd_ticket(), self.all_input_ports_ticket()},
        )

    def _calc_state_measured(self, context: Context, output: BasicVector) -> None:
        errors = context.get_discrete_state(0).value()
        measured: Vector = self._sensed.Eval(context) + errors
        play = value_or_none(self._play, context)
        if play is not None:
            measured[: self._n] += play
        output.SetFromVector(measured)


class TorqueErrors(_NoisyReadings):
    """Turns true joint torques into readings of imperfect torque sensors.

    .. pydrake_system::

        name: TorqueErrors
        input_ports:
        - torque
        output_ports:
        - torque_measured

    Both ports have n entries [N m].

    Args:
        full_scale: Torques that `config`'s shares refer to, shape (n,) [N m].
        config: Offset and noise.
        period: Time between draws of the noise [s].
        seed: The scenario's random seed.
    """

    def __init__(
        self, full_scale: Vector, config: ArmErrorsConfig, period: float, seed: int
    ) -> None:
        offset = config.torque_offset * full_scale
        sigma = config.torque_noise * full_scale
        super().__init__(offset, sigma, period, (seed, "torque"))
        n = len(offset)
        self._torque = self.DeclareVectorInputPort(name="torque", size=n)
        self.DeclareVectorOutputPort(
            name="torque_measured",
            size=n,
            calc=self._calc_torque_measured,
            prerequisites_of_calc={self.xd_ticket(), self._torque.ticket()},
        )

    def _calc_torque_measured(self, context: Context, output: BasicVector) -> None:
        errors = context.get_discrete_state(0).value()
        output.SetFromVector(self._torque.Eval(context) + errors)


def AddLatency(
    builder: DiagramBuilder, command: InputPort, latency: float, period: float
) -> InputPort:
    """Add a system that delays an input, if there is latency; it is named after it.

    Returns:
        The input to use in place of `command`.
    """
    if latency == 0.0:
        return command
    errors = builder.AddNamedSystem(
        f"{command.get_name()}_errors",
        CommandErrors(command.size(), latency, 0.0, period),
    )
    builder.Connect(errors.GetOutputPort("delayed"), command)
    return errors.get_input_port()


def AddEncoderNoise(
    builder: DiagramBuilder,
    state: OutputPort,
    config: JointErrorsConfig,
    period: float,
    seed: int,
    name: str,
) -> OutputPort:
    """Add `encoder_errors` after a state if there is noise.

    Returns:
        The output to use in place of `state`.
    """
    if config.encoder_noise == 0.0:
        return state
    size = state.size() // 2
    errors = builder.AddNamedSystem(
        "encoder_errors", EncoderErrors(size, config, period, seed, name)
    )
    builder.Connect(state, errors.GetInputPort("state"))
    return errors.get_output_port()
