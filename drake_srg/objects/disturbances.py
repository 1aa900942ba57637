"""Configuration of disturbances: forces on objects that the robot does not exert."""

import dataclasses as dc
from typing import TypeAlias

from drake_srg.types import Mode, positive


@dc.dataclass(kw_only=True)
class Disturbance:
    """Which object is disturbed, and when."""

    # The planner's mode that triggers it.
    at: str = dc.field(
        default=Mode.PRE_GRASP.value,
        metadata={
            "among": tuple(m.value for m in Mode if m not in (Mode.DONE, Mode.FAILED))
        },
    )
    # Delay from the mode's beginning [s]. By then, the mode may be another.
    after: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # It happens whenever the mode begins, up to this often.
    times: int = dc.field(default=1, metadata={"ge": 1})
    object: str | None = None  # null: the picked one


@dc.dataclass(kw_only=True)
class Push(Disturbance):
    """A hand lifts the object a little, moves it without turning it, and lets go.

    Its force is at most three times the object's weight, so a firmly held object stays.
    """

    # Of the object, in world [m].
    displacement: list[float] = dc.field(
        default_factory=lambda: [0.03, 0.0, 0.0], metadata={"length": 3}
    )
    duration: float = dc.field(default=0.4, metadata=positive())  # s, rest to rest


@dc.dataclass(kw_only=True)
class Topple(Disturbance):
    """A hand pushes at the top of a cylinder or box, ever harder, until it falls."""

    # Horizontal, [x, y] in world, of any length.
    direction: list[float] = dc.field(
        default_factory=lambda: [1.0, 0.0], metadata={"length": 2}
    )


@dc.dataclass(kw_only=True)
class Force(Disturbance):
    """A constant force at the object's centre of mass, and a constant torque."""

    force: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 0.0], metadata={"length": 3}
    )  # N, in world
    torque: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 0.0], metadata={"length": 3}
    )  # N m, in world
    duration: float = dc.field(default=0.1, metadata=positive())  # s


AnyDisturbance: TypeAlias = Push | Topple | Force
