"""How the pick-and-place planner works."""

import dataclasses as dc

from drake_srg.planning.motion.config import MotionConfig
from drake_srg.types import positive


@dc.dataclass(kw_only=True)
class PlannerConfig(MotionConfig):
    """How the planner works, on top of how it moves. Times are simulated."""

    # From a decision to the first motion [s]: planning takes this long.
    latency: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # Grasps tried before the planner gives up.
    max_attempts: int = dc.field(default=3, metadata={"ge": 1})
    # The planner gives up after this long, a cycle [s].
    time_budget: float = dc.field(default=40.0, metadata=positive())
    # How long an object is looked for, and how often [s].
    search_time: float = dc.field(default=0.5, metadata={"ge": 0.0})
    search_period: float = dc.field(default=0.25, metadata=positive())
    # Directions from which objects are taken: above, side.
    approaches: list[str] = dc.field(
        default_factory=lambda: ["above", "side"],
        metadata={"among": ("above", "side")},
    )
    # For grasps from the side, how far the hand points down [rad]: none, 3, 5 and 10
    # degrees. A tilt keeps the wrist off the table, but tilts the object in the hand.
    tilts: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.05, 0.0873, 0.1745],
        metadata={"ge": 0.0, "le": 0.7},
    )
    # What the closed command asks for beyond the contact, base + tip [rad]; 0.4 rad
    # presses with about 14 N a finger (see `SrgPositionDriver`'s gains), more than four
    # times what a can of 0.42 kg needs at friction 0.6.
    squeeze: float = dc.field(default=0.4, metadata=positive())
    # Distance kept by the arm and by the hand from what they must not touch [m].
    clearance: float = dc.field(default=0.01, metadata={"ge": 0.0})
    hand_clearance: float = dc.field(default=0.005, metadata={"ge": 0.0})
    # Height above the table at which the object is let go [m]: more than the error of
    # the localisation, so that it is not pressed into the table.
    place_height: float = dc.field(default=0.0005, metadata={"ge": 0.0})
    # Mass in the hand that the torque limits allow for [kg].
    payload: float = dc.field(default=0.5, metadata={"ge": 0.0})
    # An arm that is this late is stopped by something [s].
    arrival_timeout: float = dc.field(default=1.0, metadata=positive())
    # Protective stop: torques from outside (see `AddExternalTorque`) that end the task
    # when the arm moves, one a joint [N m]; what is carried counts. null: none. With a
    # can, the fast kitchen's iiwa 14 feels up to 4, at its wrist 0.3, with a cylinder
    # the five-axis arm 0.12; errors of torque sensors come on top.
    max_external_torque: list[float] | None = dc.field(
        default=None, metadata=positive()
    )
    # Until then after a command, fingers at rest may just not have begun to move [s].
    gripper_reaction: float = dc.field(default=0.2, metadata={"ge": 0.0})
    # How long the fingers may take to close or open [s].
    gripper_timeout: float = dc.field(default=1.5, metadata=positive())
    # The grasp is checked for this long before and after lifting [s].
    verify_time: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # What the hand carries is lost where nothing has been sensed between the fingers
    # for this long [s]: longer than `grasp_detector.post_contact_delay`, so that a
    # sensor that fails to see it once does not count.
    slip_time: float = dc.field(default=0.15, metadata=positive())
    # The same where the gripper's joints close by so much on average within that time
    # [rad]. Fingers around something give way to one another, which leaves the average
    # alone: it changed by less than 0.001 rad with a can between fingertips, by 0.01
    # rad where fingers that wrap settle. Those that lose a can close by 0.1 rad.
    slip_closing: float = dc.field(default=0.03, metadata=positive())
    # What has been lost or missed is pressed so many times as firmly from then on.
    regrasp_squeeze: float = dc.field(default=1.5, metadata={"ge": 1.0})
    # Whether to look again when the hand is in front of the object, and to plan anew
    # where it has moved; for cameras that see it there.
    look_before_grasp: bool = False
    # Whether to look for the object in the hand above the goal, and to place it from
    # where it is seen; for cameras that see it there.
    look_before_place: bool = False
    # How long the arm waits at least, with closed fingers before it lifts, with open
    # ones before it leaves, and at home [s].
    grip_wait: float = dc.field(default=0.0, metadata={"ge": 0.0})
    release_wait: float = dc.field(default=0.0, metadata={"ge": 0.0})
    home_wait: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # How long the fingers are given to close at home, empty [s]; 0 leaves them open.
    close_at_home: float = dc.field(default=0.0, metadata={"ge": 0.0})
    period: float = dc.field(default=0.01, metadata=positive())  # s
