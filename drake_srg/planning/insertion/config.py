"""Configuration, knowledge and memory of the planner that inserts pegs into holes."""

import dataclasses as dc
import enum

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.config import positive
from drake_srg.planning.pick_and_place.knowledge import PlannerMemory
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.planning.servoing.hand_motion import ServoArm
from drake_srg.planning.state_machine import Memory
from drake_srg.types import Box, Cylinder, Failure, Vector


@dc.dataclass(kw_only=True)
class Insert(PlannerConfig):
    """Picks the peg that `task.pick` names, and inserts it where its goal is.

    The goal is the seated peg; its rotation about its axis is ignored. The arm must
    yield: `arm: !ArmImpedanceDriver` with `cartesian`.
    """

    # Name of the hole's model among `directives`, which only metrics use. Its origin is
    # the middle of the rim, z up.
    hole: str = "hole"
    # Depth of the hole [m], and felt depth short of it that counts as seated [m]: the
    # rim is felt to a millimetre or so.
    depth: float = dc.field(default=0.02, metadata=positive())
    depth_tolerance: float = dc.field(default=0.002, metadata=positive())
    # Strategy by which the peg finds the hole. `tilt`: it leans against the wall and is
    # put upright. `push`: it goes straight down. `spiral`: its end searches the rim.
    strategy: str = dc.field(
        default="tilt", metadata={"among": ("tilt", "push", "spiral")}
    )
    # Distance between turns of the spiral [m], less than 2 clearances, and its radius.
    spiral_pitch: float = dc.field(default=1.5e-4, metadata=positive())
    spiral_radius: float = dc.field(default=0.002, metadata=positive())
    # Half the width of the peg's end, or of a cap's bore [m]; null: half the shape's
    # width.
    tip: float | None = dc.field(default=None, metadata=positive())
    # Whether the peg is a cap that goes over a pin.
    over: bool = False
    # Amplitude of the turns about its axis [rad]. A cylinder turns once it has entered,
    # so that friction acts along the turn and hardly resists the descent. A box, the
    # proxy of a peg with a key or corners, turns around its goal while it hardly sinks,
    # to find its way.
    twist: float = dc.field(default=0.15, metadata={"ge": 0.0, "le": 0.2})
    # Height over the hole at which the insertion begins [m].
    hover: float = dc.field(default=0.008, metadata=positive())
    # Stiffness of the hand, as in `arm.cartesian` [N/m], [N m/rad].
    stiffness: float = dc.field(default=2000.0, metadata=positive())
    turning_stiffness: float = dc.field(default=200.0, metadata=positive())
    # Forces with which the hand pulls the peg [N]: down in search of the hole, sideways
    # against its wall (on the way there, as much down), and down into it. No set-point
    # pulls harder than `force_limit` [N] and `torque_limit` [N m].
    search_force: float = dc.field(default=5.0, metadata=positive())
    side_force: float = dc.field(default=3.0, metadata=positive())
    push_force: float = dc.field(default=6.0, metadata=positive())
    force_limit: float = dc.field(default=15.0, metadata=positive())
    torque_limit: float = dc.field(default=4.0, metadata=positive())
    # Torque that puts a pressed peg upright while it is so shallow that it can wedge
    # [N m]; the fingers hold it along the pinch axis against about 3 N at its end.
    upright_torque: float = dc.field(default=0.15, metadata={"ge": 0.0})
    # Tilt of the peg [rad], and its turning rate [rad/s].
    tilt: float = dc.field(default=0.105, metadata=positive(le=0.3))
    turning: float = dc.field(default=0.105, metadata=positive())
    # Distance inside the rim at which the lower edge is set down [m]. It should exceed
    # the goal's error; otherwise, a try from another side must compensate.
    inset: float = dc.field(default=0.0025, metadata=positive())
    # Speed of the peg in search of contact, and in the hole [m/s].
    tip_speed: float = dc.field(default=0.01, metadata=positive())
    # Tries from alternating sides, with steps aside [m]: for a cylinder from the third
    # on, for a box from the second on.
    tries: int = dc.field(default=4, metadata={"ge": 1})
    search_step: float = dc.field(default=0.0015, metadata={"ge": 0.0})
    # Rate at which a set-point drifts to the measurement where the peg must find its
    # own way [1/s].
    drift: float = dc.field(default=8.0, metadata=positive())


class InsertMode(enum.Enum):
    """Modes between placing and releasing."""

    TILT = "tilt"
    SEARCH = "search"
    SLIDE = "slide"
    SPIRAL = "spiral"
    UPRIGHT = "upright"
    PRESS = "press"
    RELAX = "relax"
    WITHDRAW = "withdraw"


@dc.dataclass
class Insertion(Memory):
    """Progress of an insertion; T is the peg's tip, z along the peg into the hand."""

    tries: int = 0
    # Wobble beyond the followed orientation, and turn about the axis, shape (3,) [rad].
    twist: Vector = dc.field(default_factory=lambda: np.zeros(3))
    spiral_at: float = 0.0  # when the spiral began [s]
    fallen_at: float = 0.0  # until then, the edge was no deeper than at first [s]
    pressed_at: float = 0.0  # start of the pressing [s]
    entered_at: float = 0.0  # until then, the peg had not entered the hole [s]
    # Felt depth when the peg last sank noticeably [m], and the time of that [s].
    sunk: float = 0.0
    sunk_at: float = 0.0
    # Commanded joints (N,) [rad], and their velocities [rad/s].
    q: Vector = dc.field(default_factory=lambda: np.zeros(0))
    v: Vector = dc.field(default_factory=lambda: np.zeros(0))
    X_TG: RigidTransform | None = None  # the hand in the tip's frame [m]
    X_WU: RigidTransform | None = None  # the tip, upright on the goal's rim [m]
    along: Vector = dc.field(default_factory=lambda: np.zeros(3))  # pinch axis, level
    angle: float = 0.0  # commanded tilt: the side towards `along` is lower [rad]
    X_WT: RigidTransform = dc.field(default_factory=RigidTransform)  # set-point [m]
    X_WT_measured: RigidTransform = dc.field(default_factory=RigidTransform)
    p: Vector = dc.field(default_factory=lambda: np.zeros(3))  # measured, smoothed [m]
    began: Vector = dc.field(default_factory=lambda: np.zeros(3))  # p as a mode began
    # The mode's progress [m] at its last significant increase, and the time of that
    # [s].
    progress: float = 0.0
    progress_at: float = 0.0
    rim: float = 0.0  # height of the rim, as felt [m]
    # The tip of a seated peg [m].
    X_WT_rest: RigidTransform = dc.field(default_factory=RigidTransform)
    deepest: float = 0.0  # depth reached by a failed try [m]
    seated: bool = False
    stops: tuple[Failure, ...] = ()  # what ended each try


@dc.dataclass
class InsertMemory(PlannerMemory):
    """The planner's memory."""

    insertion: Insertion = dc.field(default_factory=Insertion)


def insertion_of(memory: PlannerMemory) -> Insertion:
    """Return the memory of the insertion."""
    assert isinstance(memory, InsertMemory)
    return memory.insertion


@dc.dataclass(frozen=True)
class Task:
    """The knowledge of all modes of an insertion.

    Attributes:
        config: Forces, speeds and limits.
        arm: The arm's kinematics.
        peg: The peg's shape.
        X_WO_goal: The seated peg [m].
        tolerance: Height over it above which a seen peg is not seated [m].
    """

    config: Insert
    arm: ServoArm
    peg: Cylinder | Box
    X_WO_goal: RigidTransform
    tolerance: float

    @property
    def radius(self) -> float:
        """Half the width of the peg's end, or of the bore that goes over a pin [m]."""
        return self.config.tip or 0.5 * float(self.peg.bounding_size[0])

    @property
    def round(self) -> bool:
        """Whether the peg may turn about its axis."""
        return isinstance(self.peg, Cylinder)

    @property
    def inset(self) -> float:
        """Distance of the lower edge inside the hole's outline [m].

        The edge of a bore is outside the pin's outline.
        """
        inset = self.config.inset if self.config.strategy == "tilt" else 0.0
        return -inset if self.config.over else inset

    @property
    def tilt(self) -> float:
        """Lean of the peg when it is set down on the rim [rad]."""
        return self.config.tilt if self.config.strategy == "tilt" else 0.0

    def wall(self, tip: Insertion) -> Vector:
        """Return the direction in which the lower edge meets the wall, shape (3,)."""
        return -tip.along if self.config.over else tip.along


def centred(q: Vector) -> Vector:
    """Return the angles (n,) of two fingers, left and right in turn, averaged [rad].

    Those of another hand are returned unchanged.
    """
    if len(q) % 2:
        return q
    return np.repeat(0.5 * (q[0::2] + q[1::2]), 2)
