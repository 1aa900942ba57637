"""The safety monitor between the commands and the arm's driver."""

import dataclasses as dc
import math
from collections.abc import Callable, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    InputPort,
)

from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.arm.safety.limits import (
    Command,
    JointLimits,
    Tool,
    ToolLimits,
    TouchLimits,
    check_command,
)
from drake_srg.arm.safety.path import Memory, Path
from drake_srg.common.safety_states import SafetyState, StopReason
from drake_srg.common.systems import AddUnique
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class Observation:
    """Facts that decide the next state of the monitor."""

    reason: StopReason = StopReason.NONE  # the first present reason to stop, if any
    braked_for: StopReason = StopReason.NONE  # the reason of the stop in progress
    standstill: bool = False  # the monitor's commands are at rest
    released: bool = False  # the stop has just been acknowledged

    @property
    def emergency(self) -> bool:
        """Whether the button is pressed."""
        return self.reason is StopReason.EMERGENCY_STOP

    @property
    def may_run(self) -> bool:
        """Whether the stop is acknowledged and its cause has ended."""
        return self.released and self.reason is StopReason.NONE


# state: [(condition; next state)]. The first condition that holds decides.
TRANSITIONS: dict[
    SafetyState, list[tuple[Callable[[Observation], bool], SafetyState]]
] = {
    SafetyState.RUNNING: [
        (lambda o: o.reason is not StopReason.NONE, SafetyState.BRAKING),
    ],
    SafetyState.BRAKING: [
        (
            lambda o: o.standstill and o.braked_for is StopReason.EMERGENCY_STOP,
            SafetyState.EMERGENCY_STOP,
        ),
        (lambda o: o.standstill, SafetyState.PROTECTIVE_STOP),
    ],
    SafetyState.PROTECTIVE_STOP: [
        (lambda o: o.emergency, SafetyState.EMERGENCY_STOP),
        (lambda o: o.may_run, SafetyState.RUNNING),
    ],
    SafetyState.EMERGENCY_STOP: [
        (lambda o: o.may_run, SafetyState.RUNNING),
    ],
}


def transition(state: SafetyState, observation: Observation) -> SafetyState:
    """Return the state that follows, by the table `TRANSITIONS`."""
    for condition, following in TRANSITIONS[state]:
        if condition(observation):
            return following
    return state


_STOPS = (SafetyState.PROTECTIVE_STOP, SafetyState.EMERGENCY_STOP)


class SafetyMonitor(LeafSystem):
    """Passes commands on as long as they and the arm stay within limits.

    .. pydrake_system::

        name: SafetyMonitor
        input_ports:
        - position_commanded
        - state_measured (optional)
        - external_torque (optional)
        - estop (optional)
        - release (optional)
        - speed_override (optional)
        - heartbeat (optional)
        output_ports:
        - position_allowed
        - position_held
        - state
        - speed_scale

    Inputs: `position_commanded` (N) [rad or m], a new command every `period`;
    `state_measured` (2N), [q; v] of the arm; `external_torque` (N) [N m]; `estop` (1),
    nonzero or NaN while the button is pressed; `release` (1), which acknowledges a stop
    when it becomes nonzero; `speed_override` (1), clipped to 0 .. 1, which replaces the
    configuration's value; `heartbeat` (1), the time at which the newest message arrived
    [s], NaN before the first.

    Outputs: `position_allowed` (N) [rad or m], for the arm's driver; `position_held`
    (N), the same while the arm rests in a stop, otherwise NaN; `state` (2), the indices
    into `STATES` and `REASONS`; `speed_scale` (1), the speed along the path as a share
    of the commanded one, 0 .. 1.

    Without a fault, each command passes unchanged, one period after the update that
    read it, because outputs change only in updates. On any violation, the arm brakes
    along the path of the commands, as hard as the limits allow (a category 1 stop, IEC
    60204-1). It rests until the cause has ended and the stop is acknowledged. The
    monitor remembers commands that arrive meanwhile, and after a protective stop, the
    arm continues along them. After an emergency stop, or after a command that broke a
    limit, the arm waits for commands that begin at its rest position.

    `TRANSITIONS` is the table of the states, and `limits.check_command` finds faults of
    commands. All state is discrete.

    Args:
        home: Start of the commands, shape (N,) [rad or m].
        limits: Limits of the joints.
        config: All other limits and times.
        period: The control period [s].
        tool: Limits of the tool, if there are any.
        touch: Limits of external torques and forces, if there are any.
    """

    def __init__(
        self,
        home: Vector,
        limits: JointLimits,
        config: SafetyConfig,
        period: float,
        tool: ToolLimits | None = None,
        touch: TouchLimits | None = None,
    ) -> None:
        super().__init__()
        self._limits, self._config, self._period = limits, config, period
        self._n = n = len(home)
        self._tool, self._touch = tool, touch
        error = config.following_error
        self._following_error = math.inf if error is None else error
        capacity = math.ceil(config.path_memory / period)
        start = Memory.at_rest(home, self._command_at(home))
        self._flat = int(self.DeclareDiscreteState(start.flat()))
        self._ahead = int(self.DeclareDiscreteState(np.zeros(capacity * n)))
        self._capacity = capacity

        def declare(name: str, size: int) -> InputPort:
            return self.DeclareVectorInputPort(name=name, size=size)

        self._commanded = declare("position_commanded", n)
        self._measured = declare("state_measured", 2 * n)
        self._torque = declare("external_torque", n)
        self._estop = declare("estop", 1)
        self._release = declare("release", 1)
        self._override = declare("speed_override", 1)
        self._heartbeat = declare("heartbeat", 1)
        for name, size, calc in (
            ("position_allowed", n, self._calc_position),
            ("position_held", n, self._calc_held),
            ("state", 2, self._calc_state),
            ("speed_scale", 1, self._calc_speed_scale),
        ):
            self.DeclareVectorOutputPort(
                name=name,
                size=size,
                calc=calc,
                prerequisites_of_calc={self.xd_ticket()},
            )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        flat = context.get_discrete_state(self._flat).value()
        output.SetFromVector(Memory.position(flat, self._n))

    def _calc_held(self, context: Context, output: BasicVector) -> None:
        memory = self._memory(context)
        stopped = memory.state in _STOPS
        output.SetFromVector(memory.path.q if stopped else np.full(self._n, np.nan))

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._memory(context).indices)

    def _calc_speed_scale(self, context: Context, output: BasicVector) -> None:
        output[0] = self._memory(context).rate

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        memory = self._advanced(self._memory(context), context, context.get_time())
        discrete_state.set_value(self._flat, memory.flat())
        ahead = memory.path.ahead.ravel()
        discrete_state.get_mutable_value(self._ahead)[: len(ahead)] = ahead

    def _memory(self, context: Context) -> Memory:
        flat = context.get_discrete_state(self._flat).value()
        ahead = context.get_discrete_state(self._ahead).value()
        return Memory.of(flat, ahead, self._n)

    def _advanced(self, memory: Memory, context: Context, time: float) -> Memory:
        """Return the memory one control period later."""
        now, since = self._condition(memory, context, time)
        path, command, cut = memory.path, memory.command, memory.cut
        if not cut:
            q = self._commanded.Eval(context)
            fault, command, path = self._received(memory, q)
            cut = fault is not StopReason.NONE
            now = fault if now is StopReason.NONE else now
        reason = memory.reason
        if now is not StopReason.NONE and (
            reason is StopReason.NONE or now is StopReason.EMERGENCY_STOP
        ):
            reason = now
        pressed = _value(self._release, context) > 0.5
        observation = Observation(
            reason=now,
            braked_for=reason,
            standstill=not memory.path.step.any(),
            released=pressed and not memory.release_pressed,
        )
        state = transition(memory.state, observation)
        running = state is SafetyState.RUNNING
        if running and memory.state is not SafetyState.RUNNING:
            reason, cut = StopReason.NONE, False
        memory = Memory(path, command, state, reason, memory.rate, since, pressed, cut)
        return self._moved(memory, context) if running else self._braked(memory)

    def _condition(
        self, memory: Memory, context: Context, time: float
    ) -> tuple[StopReason, float]:
        """Return the first present reason to stop, if any, apart from invalid commands.

        The second value is the memory's new `pressed_since` [s].
        """
        since = memory.pressed_since
        if not -0.5 <= _value(self._estop, context) <= 0.5:
            return StopReason.EMERGENCY_STOP, since
        if self._heartbeat.HasValue(context):
            age = time - self._heartbeat.Eval(context)[0]
            if not age <= self._config.watchdog:
                return StopReason.STALE, since
        q, reason = memory.path.q, StopReason.NONE
        if self._measured.HasValue(context):
            measured = self._measured.Eval(context)
            reason = self._limits.measured_fault(
                measured, q, self._following_error, self._period
            )
            q = measured[: self._n]
        felt = self._torque.HasValue(context)
        if reason is not StopReason.NONE or self._touch is None or not felt:
            return reason, since
        return self._touch.fault(q, self._torque.Eval(context), since, time)

    def _received(self, memory: Memory, q: Vector) -> tuple[StopReason, Command, Path]:
        """Return a command's fault; add the command to the path if it has none."""
        path, last = memory.path, memory.command
        fault, command = check_command(q, last, self._limits, self._tool)
        if fault is not StopReason.NONE:
            return fault, command, path
        # After a stop for another reason, the arm may be off the commands' path.
        continues = np.array_equal(path.end, last.q)
        if not continues or len(path.ahead) >= self._capacity:
            return StopReason.LAG, last, path
        return fault, command, path.extended(command.q)

    def _moved(self, memory: Memory, context: Context) -> Memory:
        """Return the memory after a step along the path at the allowed speed."""
        path, rate = memory.path, self._config.speed_override
        if self._override.HasValue(context):
            rate = float(self._override.Eval(context)[0])
            rate = min(max(rate, 0.0), 1.0) if math.isfinite(rate) else 0.0
        if rate == 1.0:
            taken = path.taken(self._limits.bend)
            if taken is not None:
                return dc.replace(memory, path=taken, rate=1.0)
        if not len(path.ahead) and not path.step.any():
            return dc.replace(memory, rate=rate)  # the arm rests at the end of its path
        moved = path.advanced(rate, self._limits.bend)
        return dc.replace(memory, path=moved, rate=moved.rate)

    def _braked(self, memory: Memory) -> Memory:
        """Return the memory after a step that slows the arm down, or at rest."""
        path = memory.path
        if path.step.any():
            path = path.advanced(0.0, self._limits.brake)
        memory = dc.replace(memory, path=path, rate=path.rate)
        emergency = memory.reason is StopReason.EMERGENCY_STOP
        if path.step.any() or not (memory.cut or emergency):
            return memory
        rest, command = Path.at_rest(path.q), self._command_at(path.q)
        return dc.replace(memory, path=rest, command=command, cut=True)

    def _command_at(self, q: Vector) -> Command:
        """Return the command to rest at joint positions (N,)."""
        limits = self._tool
        tool = np.full(3, np.nan) if limits is None else limits.position(q)
        return Command(q, np.zeros(len(q)), tool)


def _value(port: InputPort, context: Context) -> float:
    """Return the number at a port, 0 if it is not connected."""
    return float(port.Eval(context)[0]) if port.HasValue(context) else 0.0


def AddSafetyMonitor(
    builder: DiagramBuilder,
    models_plant: MultibodyPlant,
    home: Sequence[float],
    config: SafetyConfig,
    period: float,
    arm: str = "arm",
    name: str = "safety_monitor",
) -> SafetyMonitor:
    """Add a safety monitor to a diagram; the caller connects its ports.

    Args:
        builder: Builder of the diagram.
        models_plant: A finalized plant with the arm and its hand.
        home: Start of the commands, shape (N,) [rad or m].
        config: The limits.
        period: Period of the arm's driver [s].
        arm: Name of the arm's model instance.
        name: Name of the monitor in the diagram.

    Raises:
        ValueError: If the limits do not fit the arm, the tool does not exist, or the
            name is taken.
    """
    instance = models_plant.GetModelInstanceByName(arm)
    limits = JointLimits.of_plant(models_plant, instance, config, period)
    tool = Tool(models_plant, arm, config.tool) if config.needs_tool else None
    monitor = SafetyMonitor(
        np.array(home),
        limits,
        config,
        period,
        ToolLimits.of(config, tool.position, period) if tool else None,
        TouchLimits.of(config, len(home), tool),
    )
    return AddUnique(builder, name, monitor)
