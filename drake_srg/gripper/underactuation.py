"""Algorithm 1 of the SRG thesis: four joint targets from one command and sensors."""

import dataclasses as dc
import math

from pydrake.systems.framework import Context, DiscreteValues

from drake_srg.common.srg_geometry import SRG
from drake_srg.common.systems import value_or_none
from drake_srg.config import Config, positive
from drake_srg.lifetime import LeafSystem

# Order of the SRG's joints and sensors, here and at every port; the plant's order
# differs. A finger is a pair of indices (base, tip) into this order.
JOINT_NAMES = (
    "left_base_joint",
    "right_base_joint",
    "left_tip_joint",
    "right_tip_joint",
)
FINGERS = ((0, 2), (1, 3))
BASES = ("algorithm_1", "freeze")
TIPS = ("algorithm_1", "curl")
EVALUATIONS = ("periodic", "per_message")


@dc.dataclass(kw_only=True)
class UnderactuationConfig(Config):
    """Parameters of Algorithm 1."""

    # Base plus tip angle at closure 1 [rad].
    full_scale: float = dc.field(default=SRG.full_scale, metadata=positive())
    # Limit of the bases' targets [rad]; targets of the tips saturate at the joint's
    # limit.
    base_limit: float = dc.field(default=SRG.joint_limit, metadata=positive())
    # Tip angle up to which a finger counts as straight [rad]. The thesis tests `tip
    # angle <= 0`, but a joint's stop is compliant.
    straight_tolerance: float = dc.field(default=0.002, metadata={"ge": 0.0})
    # Behaviour of a base whose sensor fires while the hand closes. `algorithm_1`: it
    # keeps its target, and so continues into the object. `freeze`: its target becomes
    # the angle at which the sensor fired, or the farthest angle that the base reaches
    # before it stops.
    base: str = dc.field(default="algorithm_1", metadata={"among": BASES})
    # Speed at which a frozen base then approaches the object [rad/s]; 0: it stays. Its
    # target stays within `approach_error` [rad] of the measured angle, which limits the
    # force as `planner.squeeze` does.
    approach_speed: float = dc.field(default=0.0, metadata={"ge": 0.0})
    approach_error: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # Behaviour of a tip whose sensor fires while its base's does not. `algorithm_1`: it
    # keeps its target. Around something wide and low, straight fingers lean outwards,
    # and their pads push the object down and out of the hand. `curl`: if both tips
    # sense something while the bases lean outwards (`curl_lean`), the tips close, and
    # the bases give way until the pads are upright. This needs a motor at each joint. A
    # wire turns the base 2.9 times as hard as the tip (`base_moment_arm`), but a force
    # on the middle of the pad turns the base only 2.5 times as hard as the tip. So with
    # a wire, the tip stays straight.
    tip: str = dc.field(default="algorithm_1", metadata={"among": TIPS})
    # Mean outward lean of the bases above which tips curl [rad]. The default is reached
    # around things wider than 75 mm. Friction holds narrower things, and a curling tip
    # would push them aside.
    curl_lean: float = dc.field(default=0.15, metadata={"ge": 0.0})
    # When the algorithm runs. `periodic`: every `period`. `per_message`: only in
    # periods in which a message has arrived, even one that repeats the last, because
    # the thesis runs it in the callback of /grasp.
    evaluate: str = dc.field(default="periodic", metadata={"among": EVALUATIONS})
    # Time between evaluations [s]: the period of the proximity sensors.
    period: float = dc.field(default=0.01, metadata=positive())


def finger_targets(
    target: float,
    opening: bool,
    angles: tuple[float, float],
    fired: tuple[bool, bool],
    last: tuple[float, float],
    straight_tolerance: float = 0.0,
    curl: bool = False,
) -> tuple[float, float]:
    """Evaluate Algorithm 1 for one finger, as the Lua code of the SRG thesis does.

    Args:
        target: Commanded base plus tip angle [rad].
        opening: Whether the command decreased when it last changed.
        angles: Measured base and tip angles [rad].
        fired: Whether the sensors of base and tip fire.
        last: Base and tip targets of the last evaluation [rad].
        straight_tolerance: Tip angle up to which the finger counts as straight [rad].
        curl: Whether a tip that senses something closes even if its base senses
            nothing. This is not in the thesis.

    Returns:
        The new base and tip targets [rad].
    """
    base, tip = angles
    base_target, tip_target = last
    if opening:
        if tip <= straight_tolerance:
            return target, 0.0
        return base_target, target - base
    if not fired[0] and not (curl and fired[1]):
        return target, tip_target
    if not (fired[0] and fired[1]):
        return base_target, target - base
    share = 0.5 * (target - base - tip)
    return base + share, tip + share


class UnderactuationLogic(LeafSystem):
    """Turns one closure command into the targets of the four finger joints.

    .. pydrake_system::

        name: UnderactuationLogic
        input_ports:
        - closure_commanded
        - state_measured
        - triggered
        - joint_position_commanded (optional)
        - hold (optional)
        - closure_messages (with per_message)
        output_ports:
        - position_desired

    Inputs:

    * `closure_commanded` (1): 0 open .. 1 closed, clipped, NaN ignored;
    * `state_measured` (8): [q; v] in rad, rad/s;
    * `triggered` (4): nonzero where a sensor fires;
    * `joint_position_commanded` (4) [rad]: finite entries override the algorithm;
    * `hold` (1): while nonzero, a finger that touches something keeps its targets, and
      so its grip. Other fingers keep the angles that they had when the hold began;
    * `closure_messages` (1): number of messages so far that commanded a closure. The
      algorithm runs only when this number has changed.

    The output `position_desired` (4) [rad] is updated every `config.period`. When a
    simulation starts, it is the fingers' position. Joints and sensors are in the order
    of `JOINT_NAMES`.
    """

    def __init__(self, config: UnderactuationConfig | None = None) -> None:
        super().__init__()
        self.config = config or UnderactuationConfig()
        self._limits = 2 * [self.config.base_limit] + 2 * [SRG.joint_limit]
        self._closure, self._measured, self._triggered, self._commanded, self._hold = (
            self.DeclareVectorInputPort(name=name, size=size)
            for name, size in (
                ("closure_commanded", 1),
                ("state_measured", 8),
                ("triggered", 4),
                ("joint_position_commanded", 4),
                ("hold", 1),
            )
        )
        if self.config.evaluate == "per_message":
            self._messages = self.DeclareVectorInputPort(
                name="closure_messages", size=1
            )
        self._desired = self.DeclareDiscreteState([0.0] * 4)
        # [Algorithm 1's targets (4), last closure, opening, holding, whether the bases'
        # sensors fired (2), number of evaluated messages]
        self._memory = self.DeclareDiscreteState([0.0] * 10)
        self.DeclareStateOutputPort("position_desired", self._desired)
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _initialize(self, context: Context, discrete_state: DiscreteValues) -> None:
        q = self._measured.Eval(context).tolist()[:4]
        closure = 0.5 * sum(q) / self.config.full_scale  # of an empty hand
        discrete_state.set_value(self._desired, q)
        discrete_state.set_value(
            self._memory, [*q, min(max(closure, 0.0), 1.0), *[0.0] * 5]
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        # Lists of floats: for so few joints, they are faster than arrays.
        desired = context.get_discrete_state(self._desired).value().tolist()
        memory = context.get_discrete_state(self._memory).value().tolist()
        targets, last_closure, evaluated = memory[:4], memory[4], memory[9]
        opening, was_holding = bool(memory[5]), bool(memory[6])
        fired_before = [value != 0.0 for value in memory[7:9]]
        messages = self._num_messages(context)
        q = self._measured.Eval(context).tolist()[:4]
        closure = float(self._closure.Eval(context)[0])
        fired = [value != 0.0 for value in self._triggered.Eval(context).tolist()]
        hold = value_or_none(self._hold, context)
        holding = hold is not None and hold[0] != 0.0
        if math.isfinite(closure):
            closure = min(max(closure, 0.0), 1.0)
            if closure != last_closure:
                opening = closure < last_closure
        else:
            closure = last_closure
        if holding:
            if not was_holding:
                desired = _hold_targets(desired, q, fired)
        else:
            if messages is None or messages != evaluated:
                if self.config.base == "freeze" and not opening:
                    targets = self._frozen(targets, q, fired, fired_before)
                fired_before, evaluated = fired[:2], messages or 0.0
                targets = self._algorithm(closure, opening, q, fired, targets)
            desired = targets
            commanded_positions = value_or_none(self._commanded, context)
            if commanded_positions is not None:
                override = commanded_positions.tolist()
                desired = [
                    commanded if math.isfinite(commanded) else target
                    for commanded, target in zip(override, targets, strict=True)
                ]
            desired = [*map(min, desired, self._limits)]
        flags = [closure, float(opening), float(holding), *fired_before, evaluated]
        discrete_state.set_value(self._desired, desired)
        discrete_state.set_value(self._memory, [*targets, *flags])

    def _num_messages(self, context: Context) -> float | None:
        """Return the number of messages; None if the algorithm is periodic."""
        if self.config.evaluate != "per_message":
            return None
        messages = value_or_none(self._messages, context)
        if messages is None:
            raise RuntimeError(
                "gripper.underactuation.evaluate: per_message needs a count of "
                "messages at the input port closure_messages (allowed without it: "
                "periodic)"
            )
        return float(messages[0])

    def _frozen(
        self,
        targets: list[float],
        q: list[float],
        fired: list[bool],
        fired_before: list[bool],
    ) -> list[float]:
        """Return the last targets, with new targets of frozen bases.

        Args:
            targets: Targets of the last evaluation [rad].
            q: Measured angles [rad].
            fired: Whether each sensor fires.
            fired_before: Whether each base's sensor fired at the last evaluation.
        """
        config, result = self.config, targets.copy()
        for base, _ in FINGERS:
            if not fired[base]:
                continue
            if not fired_before[base]:
                result[base] = q[base]
                continue
            # While a base comes to rest, its target follows it. Otherwise, the base
            # might return so far that its sensor stops firing.
            advanced = targets[base] + config.approach_speed * config.period
            approaching = min(advanced, q[base] + config.approach_error)
            result[base] = max(targets[base], q[base], approaching)
        return result

    def _algorithm(
        self,
        closure: float,
        opening: bool,
        q: list[float],
        fired: list[bool],
        targets: list[float],
    ) -> list[float]:
        config, result = self.config, targets.copy()
        lean = 0.5 * math.pi - sum(q[base] for base, _ in FINGERS) / len(FINGERS)
        # A single tip may only have brushed something in passing, or reached the object
        # first.
        both = all(fired[tip] for _, tip in FINGERS)
        curl = config.tip == "curl" and lean > config.curl_lean and both
        for base, tip in FINGERS:
            result[base], result[tip] = finger_targets(
                config.full_scale * closure,
                opening,
                (q[base], q[tip]),
                (fired[base], fired[tip]),
                (targets[base], targets[tip]),
                config.straight_tolerance,
                curl,
            )
        return result


def _hold_targets(
    targets: list[float], q: list[float], fired: list[bool]
) -> list[float]:
    result = targets.copy()
    for finger in FINGERS:
        if not any(fired[i] for i in finger):
            for i in finger:
                result[i] = q[i]
    return result
