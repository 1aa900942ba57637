"""What real joints add to commands and measurements: latency, backlash, noise."""

import dataclasses as dc
import math
import zlib

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    EventStatus,
    InputPort,
    OutputPort,
)

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector, positive


@dc.dataclass(kw_only=True)
class JointErrorsConfig:
    """Errors of a drive's link to its controller. Zero leaves everything as it is."""

    # From a command to its effect, in whole periods of the driver, rounded up [s].
    latency: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 1.0})
    # Standard deviation of measured angles [rad]; of a 12-bit encoder, rounding alone:
    # 2 pi / 4096 / sqrt(12) = 4.4e-4.
    encoder_noise: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Speeds are differences of angles over this time [s].
    velocity_window: float = dc.field(default=0.05, metadata=positive())


@dc.dataclass(kw_only=True)
class ArmErrorsConfig(JointErrorsConfig):
    """The same with gears of play."""

    # From one flank of a gear to the other, at the joint [rad]. The joint rests where
    # friction holds it: motor and encoder turn by this before it follows them back.
    backlash: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Of sensed joint torques, over the joint's effort limit: an error that stays, and
    # the standard deviation of noise. The iiwa's axis-specific torque accuracy is 2 %
    # (KUKA, LBR iiwa, technical data).
    torque_offset: float = dc.field(default=0.0, metadata={"ge": -1.0, "le": 1.0})
    torque_noise: float = dc.field(default=0.0, metadata={"ge": 0.0})


class CommandErrors(LeafSystem):
    """Delays n commands and takes up the play of gears.

    .. pydrake_system::

        name: CommandErrors
        input_ports:
        - commanded
        output_ports:
        - delayed
        - play

    `commanded` (n) is sampled every `period`; `delayed` (n) is what it was `latency`
    ago, rounded up to whole periods. Where there is backlash b, it is the
    joints' side of the gears: y follows u only as far as |u - y| <= b / 2 demands (the
    play operator: G. Tao, P. Kokotovic, Adaptive Control of Systems with Actuator and
    Sensor Nonlinearities, 1996, for a load that friction holds). `play` (n) is u - y.

    Args:
        size: n.
        latency: [s].
        backlash: b [rad].
        period: [s].
    """

    def __init__(
        self, size: int, latency: float, backlash: float, period: float
    ) -> None:
        super().__init__()
        self._n, self._half = size, 0.5 * backlash
        # A period's fraction in a million counts for rounding.
        steps = math.ceil(latency / period - 1e-6)
        # Commands of so many periods ago to now, and y.
        state = self.DeclareDiscreteState(size * (steps + 2))
        self._commanded = self.DeclareVectorInputPort(name="commanded", size=size)
        prerequisites = {self.discrete_state_ticket(state)}
        self.DeclareVectorOutputPort(
            name="delayed",
            size=size,
            calc=self._calc_delayed,
            prerequisites_of_calc=prerequisites,
        )
        self.DeclareVectorOutputPort(
            name="play",
            size=size,
            calc=self._calc_play,
            prerequisites_of_calc=prerequisites,
        )
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _rows(self, context: Context) -> Vector:
        values: Vector = context.get_discrete_state(0).CopyToVector()
        return values.reshape(-1, self._n)

    def _calc_delayed(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._rows(context)[-1])

    def _calc_play(self, context: Context, output: BasicVector) -> None:
        rows = self._rows(context)
        output.SetFromVector(rows[0] - rows[-1])

    def _initialize(
        self, context: Context, discrete_state: DiscreteValues
    ) -> EventStatus:
        u = self._commanded.Eval(context)
        rows = np.tile(u, len(self._rows(context)))
        discrete_state.set_value(rows)
        return EventStatus.Succeeded()

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        rows = self._rows(context)
        commands = np.vstack([rows[1:-1], self._commanded.Eval(context)])
        u = commands[0]
        y = np.clip(rows[-1], u - self._half, u + self._half)
        discrete_state.set_value(np.concatenate([commands.ravel(), y]))


class _NoisySensor(LeafSystem):
    """What is sensed, with an offset and with noise that is drawn every `period`."""

    def __init__(
        self,
        ports: tuple[str, str],
        offset: Vector,
        sigma: Vector,
        period: float,
        stream: tuple[int, str],
    ) -> None:
        super().__init__()
        self._offset, self._sigma, self._period = offset, sigma, period
        seed, name = stream
        self._stream = [seed, zlib.crc32(name.encode())]
        state = self.DeclareDiscreteState(offset)
        self._sensed = self.DeclareVectorInputPort(name=ports[0], size=len(sigma))
        self.DeclareVectorOutputPort(
            name=ports[1],
            size=len(sigma),
            calc=self._calc_measured,
            prerequisites_of_calc={
                self.all_input_ports_ticket(),
                self.discrete_state_ticket(state),
            },
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        # Of the time alone, so that nothing is kept outside the context.
        step = round(context.get_time() / self._period)
        generator = np.random.default_rng([*self._stream, step])
        noise = self._sigma * generator.standard_normal(len(self._sigma))
        discrete_state.set_value(self._offset + noise)

    def _calc_measured(self, context: Context, output: BasicVector) -> None:
        errors = context.get_discrete_state(0).value()
        output.SetFromVector(self._sensed.Eval(context) + errors)


class EncoderErrors(_NoisySensor):
    """Angles and speeds as encoders on the motors' side tell them.

    .. pydrake_system::

        name: EncoderErrors
        input_ports:
        - state
        - play (optional)
        output_ports:
        - state_measured

    `state` (2n) is [q; v] of the joints, `play` (n) what motors are ahead of them by,
    `state_measured` (2n) [q + play; v] with normal noise that is drawn every `period`
    from a stream that `seed` and `name` choose.

    Args:
        size: n.
        config: Of the noise.
        period: [s].
        seed: Of the scenario.
        name: Tells the streams of one scenario apart.
    """

    def __init__(
        self, size: int, config: JointErrorsConfig, period: float, seed: int, name: str
    ) -> None:
        sigma = config.encoder_noise
        speed_sigma = math.sqrt(2.0) * sigma / config.velocity_window
        super().__init__(
            ("state", "state_measured"),
            np.zeros(2 * size),
            np.repeat([sigma, speed_sigma], size),
            period,
            (seed, name),
        )
        self._play = self.DeclareVectorInputPort(name="play", size=size)

    def _calc_measured(self, context: Context, output: BasicVector) -> None:
        super()._calc_measured(context, output)
        if self._play.HasValue(context):
            play = self._play.Eval(context)
            output.get_mutable_value()[: len(play)] += play


class TorqueErrors(_NoisySensor):
    """Joint torques as sensors tell them.

    .. pydrake_system::

        name: TorqueErrors
        input_ports:
        - torque
        output_ports:
        - torque_measured

    Both (n) [N m]. What is added is drawn every `period` from a stream that `seed`
    chooses.

    Args:
        full_scale: What `config`'s shares are of, shape (n,) [N m].
        config: Offset and noise.
        period: [s].
        seed: Of the scenario.
    """

    def __init__(
        self, full_scale: Vector, config: ArmErrorsConfig, period: float, seed: int
    ) -> None:
        super().__init__(
            ("torque", "torque_measured"),
            config.torque_offset * full_scale,
            config.torque_noise * full_scale,
            period,
            (seed, "torque"),
        )


def AddLatency(
    builder: DiagramBuilder, command: InputPort, latency: float, period: float
) -> InputPort:
    """Add `command_errors` before an input, and return what to export in its place."""
    if latency == 0.0:
        return command
    errors = builder.AddNamedSystem(
        "command_errors", CommandErrors(command.size(), latency, 0.0, period)
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
    """Add `encoder_errors` after a state, and return what to take in its place."""
    if config.encoder_noise == 0.0:
        return state
    size = state.size() // 2
    errors = builder.AddNamedSystem(
        "encoder_errors", EncoderErrors(size, config, period, seed, name)
    )
    builder.Connect(state, errors.GetInputPort("state"))
    return errors.get_output_port()
