"""Configuration of taught waypoints."""

import dataclasses as dc


@dc.dataclass(kw_only=True)
class TaughtConfig:
    """The waypoints P0 to P4 of the five-axis arm's thesis; P0 is `arm.home`.

    P2 is where the localizer says, with the hand's z up. All other times and limits of
    the motions are those of `planner`.
    """

    # P1 minus P2 in world [m].
    approach: list[float] = dc.field(
        default_factory=lambda: [0.025, 0.0, 0.0], metadata={"length": 3}
    )
    # Joint positions of P3, where the object is lifted to, and P4, where it is let go
    # [rad].
    lift: list[float] = dc.field(default_factory=list, metadata={"nonempty": True})
    place: list[float] = dc.field(default_factory=list, metadata={"nonempty": True})
    # P2 in world [m] instead of where the localizer says; null: where it says.
    grasp: list[float] | None = dc.field(default=None, metadata={"length": 3})
