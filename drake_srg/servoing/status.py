"""What a visual servo is told to do, and what it tells."""

import dataclasses as dc
import enum

import numpy as np

from drake_srg.common.shared import Shared
from drake_srg.types import Vector


class ServoCommand(enum.Enum):
    """What a visual servo must do."""

    PASS = "pass"  # pass on the planned positions
    TRACK = "track"  # drive the hand by what the camera shows
    FOLLOW = "follow"  # go on as the goal last moved, without the camera
    RAISE = "raise"  # the same, but upwards; then brake, and hold the hand
    HOLD = "hold"  # brake, and hold the hand


class ServoState(enum.Enum):
    """What a visual servo does."""

    PASSING = "passing"
    TRACKING = "tracking"
    REACHED = "reached"  # tracking, with the hand at its goal
    FOLLOWING = "following"
    RAISING = "raising"
    HOLDING = "holding"
    FAILED = "failed"  # stopped, for the reason that `ServoStatus.fault` names


class ServoFault(enum.Enum):
    """Why a visual servo holds the hand."""

    LOST = "the object is not in the image, or not all of it"
    FROZEN = "the image stays the same although the hand moves"
    SILENT = "no new images arrive"
    SINGULAR = "the features do not determine the motion"
    STUCK = "the arm cannot move the hand that way"


@dc.dataclass(frozen=True, eq=False)
class ServoStatus(Shared):
    """A visual servo's report."""

    state: ServoState = ServoState.PASSING
    # Why the hand is held now, or why the servo has failed; None: it is not held.
    fault: ServoFault | None = None
    # Joint positions commanded by the servo, shape (N,) [rad]; empty while it passes.
    q: Vector = dc.field(default_factory=lambda: np.zeros(0))
    at_rest: bool = True  # whether the commands have come to rest
    error: float = np.inf  # distance from the goal in the last image [m]
    # Velocity of the goal in world, shape (3,) [m/s].
    velocity: Vector = dc.field(default_factory=lambda: np.zeros(3))
    images: int = 0  # that the servo has heeded
