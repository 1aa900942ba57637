"""Configuration, commands and status of a visual servo."""

import dataclasses as dc
import enum

import numpy as np

from drake_srg.common.shared import Shared
from drake_srg.config import Config, positive
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.types import Vector


@dc.dataclass(kw_only=True)
class ServoConfig(Config):
    """Gains, limits and tolerances of a visual servo."""

    # Time between control steps [s], preferably that of the arm's driver, and between
    # images [s], a multiple of it.
    period: float = dc.field(default=0.01, metadata=positive())
    camera_period: float = dc.field(default=0.04, metadata=positive())
    # Share of the error that the hand corrects per second [1/s]. The loop is stable
    # while the gain times the delay, here `camera_period`, is well below 1. Lower it
    # for a slower camera.
    gain: float = dc.field(default=5.0, metadata=positive())
    # Largest speed [m/s] and acceleration [m/s²] of the hand relative to a goal at
    # rest. 0.25 m/s is the usual limit of collaborative arms.
    speed: float = dc.field(default=0.25, metadata=positive())
    acceleration: float = dc.field(default=1.5, metadata=positive())
    # Whether the goal's velocity is fed forward. Otherwise, the hand trails a moving
    # goal by the goal's velocity over `gain`.
    feed_forward: bool = True
    # Delay of the arm beyond one period [s]. The servo aims that far ahead of the
    # goal.
    lag: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # The hand stays behind its goal until it is aligned: by `funnel` times the part of
    # its distance from the line of approach beyond 4 mm, and by this at most [m]. So
    # the fingers pass beside the object, not into it.
    standoff: float = dc.field(default=0.06, metadata={"ge": 0.0})
    funnel: float = dc.field(default=6.0, metadata={"ge": 0.0})
    # The goal is reached once `settled` images in a row show the hand within this
    # distance of it [m].
    tolerance: float = dc.field(default=0.003, metadata=positive())
    settled: int = dc.field(default=6, metadata={"ge": 1})
    # Height by which the hand raises the grasped object before it brakes [m].
    rise: float = dc.field(default=0.02, metadata={"ge": 0.0})
    # The servo gives up after `patience` images without a usable sighting, or as many
    # equal images while the hand moves by more than `moved` [m].
    patience: int = dc.field(default=5, metadata={"ge": 1})
    moved: float = dc.field(default=0.002, metadata=positive())
    # Number of images that the servo uses; 0: all. With 1, the hand goes to the goal as
    # seen in the first image.
    looks: int = dc.field(default=0, metadata={"ge": 0})


@dc.dataclass(kw_only=True)
class ServoingConfig(ServoConfig):
    """A visual servo that moves the hand from in front of the object to the grasp."""

    # `pbvs`: by the object's pose; `ibvs`: by its silhouette in the image.
    method: str = dc.field(default="pbvs", metadata={"among": ("pbvs", "ibvs")})
    # Name of the camera, which is fixed to the hand.
    camera: str = "hand"
    # Source of the goal. `shown`: the camera's view of an object in the hand; the
    # camera's pose need not be known. `calibrated`: the camera's calibration.
    goal: str = dc.field(default="shown", metadata={"among": ("shown", "calibrated")})
    # Time after which the servo counts as failed [s].
    time_limit: float = dc.field(default=6.0, metadata=positive())


@dc.dataclass(kw_only=True)
class WindowConfig(Config):
    """The window in which the planner takes a moving object: a rectangle in world.

    It plans once it has seen the object twice, the second time in the window. Without
    such a sighting, it gives up after `search_time`.
    """

    # Corners [x, y] in world [m].
    min: list[float] = dc.field(default_factory=list)
    max: list[float] = dc.field(default_factory=list)
    # The hand goes to where the object will be after this time [s], which covers
    # planning and the approach. The servo corrects the rest.
    lead_time: float = dc.field(default=1.5, metadata={"ge": 0.0})

    def contains(self, p_W: Vector) -> bool:
        """Return whether a position, shape (3,) [m], is above the rectangle."""
        inside = (self.min <= p_W[:2]) & (p_W[:2] <= self.max)
        return bool(inside.all())


@dc.dataclass(kw_only=True)
class Servoing(PlannerConfig):
    """Picks and places as `PickAndPlace` does, with a visual servo for the grasp."""

    # Where to take an object from a belt; null: anywhere, and only the servo notices
    # that the object moves.
    window: WindowConfig | None = None
    servo: ServoingConfig = dc.field(default_factory=ServoingConfig)


class ServoCommand(enum.Enum):
    """Command to a visual servo."""

    PASS = "pass"  # pass on the planned positions
    TRACK = "track"  # the images drive the hand
    FOLLOW = "follow"  # continue with the goal's last motion, without the camera
    RAISE = "raise"  # the same, but upwards; then brake, and hold the hand
    HOLD = "hold"  # brake, and hold the hand


class ServoState(enum.Enum):
    """State of a visual servo."""

    PASSING = "passing"
    TRACKING = "tracking"
    REACHED = "reached"  # tracking, with the hand at its goal
    FOLLOWING = "following"
    RAISING = "raising"
    HOLDING = "holding"
    FAILED = "failed"  # stopped, for the reason that `ServoStatus.fault` names


class ServoFault(enum.Enum):
    """The reason why a visual servo holds the hand."""

    LOST = "the object is not in the image, or not all of it"
    FROZEN = "the image stays the same although the hand moves"
    SILENT = "no new images arrive"
    SINGULAR = "the features do not determine the motion"
    STUCK = "the arm cannot move the hand that way"


@dc.dataclass(frozen=True, eq=False)
class ServoStatus(Shared):
    """A visual servo's report."""

    state: ServoState = ServoState.PASSING
    # Why the hand is held, or why the servo has failed; None if it moves.
    fault: ServoFault | None = None
    # Joint positions commanded by the servo, shape (N,) [rad]; empty while it passes.
    q: Vector = dc.field(default_factory=lambda: np.zeros(0))
    at_rest: bool = True  # whether the commands have come to rest
    error: float = np.inf  # distance from the goal in the last image [m]
    # Velocity of the goal in world, shape (3,) [m/s].
    velocity: Vector = dc.field(default_factory=lambda: np.zeros(3))
    images: int = 0  # number of images that the servo has used
