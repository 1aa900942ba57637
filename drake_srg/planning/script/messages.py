"""The messages that a client of the SRG thesis sends, as a script.

The thesis's clients use two topics: `/kuka`, joint positions of the arm [degrees], and
`/grasp`, percent from 0 open to 100 closed. They send message after message at a fixed
rate, in named routines, without looking at the outcome.
"""

import dataclasses as dc
from collections import Counter

import numpy as np

from drake_srg.common.exceptions import suggest
from drake_srg.planning.script.scripted import SCRIPT_MODES, ScriptStep
from drake_srg.types import Mode, positive


@dc.dataclass(kw_only=True)
class MessageConfig:
    """Messages on one of the two topics."""

    # Joint positions [degrees], the same in all `count` messages; or else `grasp`.
    kuka: list[float] | None = None
    count: int = dc.field(default=1, metadata={"ge": 1})
    # First and last i of a ramp, up or down, with one message per i that says
    # floor(i / 10) percent.
    grasp: list[int] | None = dc.field(
        default=None, metadata={"length": 2, "ge": 0, "le": 1000}
    )

    @property
    def number(self) -> int:
        """The number of messages."""
        return self.count if self.grasp is None else len(_ramp(self.grasp))


@dc.dataclass(kw_only=True)
class RoutineConfig:
    """One routine of the sequence."""

    routine: str = ""
    # The mode that metrics and recordings show.
    mode: str = dc.field(default=Mode.TRANSFER.value, metadata={"among": SCRIPT_MODES})


@dc.dataclass(kw_only=True)
class MessagesConfig:
    """Messages in the order in which they are sent, as routines."""

    rate: float = dc.field(default=25.0, metadata=positive())  # messages/s
    routines: dict[str, list[MessageConfig]] = dc.field(default_factory=dict)
    sequence: list[RoutineConfig] = dc.field(default_factory=list)
    # Time for the arm to come to rest after the last message [s].
    rest: float = dc.field(default=3.0, metadata=positive())

    def number(self) -> int:
        """Return the number of messages in the whole sequence."""
        calls = (self.routines[call.routine] for call in self.sequence)
        return sum(message.number for routine in calls for message in routine)


def message_script(config: MessagesConfig, num_joints: int) -> list[ScriptStep]:
    """Return the script of all commands, one step per change.

    Args:
        config: The messages.
        num_joints: Number of the arm's joints.

    Raises:
        ValueError: If there are no messages, a routine is unknown, or a message is not
            on exactly one topic or does not fit the arm.
    """
    for name, routine in config.routines.items():
        for i, message in enumerate(routine):
            key = f"messages.routines.{name}[{i}]"
            if (message.kuka is None) == (message.grasp is None):
                raise ValueError(f"{key}: needs either kuka or grasp")
            if message.kuka is not None and len(message.kuka) != num_joints:
                raise ValueError(
                    f"{key}.kuka: needs one entry per joint of the arm "
                    f"({num_joints}), got {len(message.kuka)}"
                )
    steps: list[ScriptStep] = []
    for i, call in enumerate(config.sequence):
        if call.routine not in config.routines:
            raise ValueError(
                f"messages.sequence[{i}].routine: unknown routine {call.routine!r} "
                f"{suggest(call.routine, config.routines)}"
            )
        for message in config.routines[call.routine]:
            steps += _steps(message, call.mode, 1.0 / config.rate)
    if not steps:
        raise ValueError("messages.sequence: needs a routine with messages")
    return [*steps, ScriptStep(mode=steps[-1].mode, duration=config.rest)]


def _steps(message: MessageConfig, mode: str, period: float) -> list[ScriptStep]:
    if message.kuka is not None:
        arm = [float(q) for q in np.deg2rad(message.kuka)]
        return [ScriptStep(mode=mode, duration=message.count * period, arm=arm)]
    assert message.grasp is not None
    percents = [i // 10 for i in _ramp(message.grasp)]
    return [
        ScriptStep(
            mode=mode,
            duration=number * period,
            closure=percent / 100.0,
            messages=number,
        )
        for percent, number in Counter(percents).items()
    ]


def _ramp(ends: list[int]) -> range:
    first, last = ends
    step = 1 if last >= first else -1
    return range(first, last + step, step)
