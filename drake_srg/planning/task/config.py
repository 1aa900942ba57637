"""Configuration of the pick-and-place planner."""

import dataclasses as dc

from drake_srg.planning.motion.config import MotionConfig
from drake_srg.types import positive


@dc.dataclass(kw_only=True)
class PlannerConfig(MotionConfig):
    """Configuration of the planner and its motions. Times are simulated."""

    # Simulated duration of planning, from a decision to the first motion [s].
    latency: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # Grasps to try before giving up.
    max_attempts: int = dc.field(default=3, metadata={"ge": 1})
    # Longest duration of a cycle before giving up [s].
    time_budget: float = dc.field(default=40.0, metadata=positive())
    # How long to look for an object, and the time between looks [s].
    search_time: float = dc.field(default=0.5, metadata={"ge": 0.0})
    search_period: float = dc.field(default=0.25, metadata=positive())
    # Directions from which to take objects.
    approaches: list[str] = dc.field(
        default_factory=lambda: ["above", "side"],
        metadata={"among": ("above", "side")},
    )
    # How far the hand may point down in grasps from the side [rad]: 0, 3, 5 or 10
    # degrees. A tilt keeps the wrist off the table, but tilts the object in the hand.
    tilts: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.05, 0.0873, 0.1745],
        metadata={"ge": 0.0, "le": 0.7},
    )
    # Closing command beyond contact, base + tip [rad]. 0.4 rad presses with about 14 N
    # per finger (see `SrgPositionDriver`'s gains), more than four times what a can of
    # 0.42 kg needs at friction 0.6.
    squeeze: float = dc.field(default=0.4, metadata=positive())
    # Distances that the arm and the hand keep from their surroundings [m].
    clearance: float = dc.field(default=0.01, metadata={"ge": 0.0})
    hand_clearance: float = dc.field(default=0.005, metadata={"ge": 0.0})
    # Height above the table at which to let go of the object [m]: more than the error
    # of the localisation, so that the object is not pressed into the table.
    place_height: float = dc.field(default=0.0005, metadata={"ge": 0.0})
    # Half the plant's step h [s]: before it places an object, the planner takes off how
    # far the simulation in steps carries it off the hand; see `carried_drift`. 0 for a
    # robot, and for steps so short that this does not matter.
    drift_time: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Mass in the hand for which the torque limits must suffice [kg].
    payload: float = dc.field(default=0.5, metadata={"ge": 0.0})
    # Delay of the arm after which something must have stopped it [s].
    arrival_timeout: float = dc.field(default=1.0, metadata=positive())
    # How far a joint may be off its path while the hand pushes things on a table, or
    # sets one down, before something must have stopped it [rad]; null: it presses on
    # until `arrival_timeout`. Its own delay puts the simulated iiwa off by up to 0.021.
    path_tolerance: float | None = dc.field(default=None, metadata=positive())
    # Protective stop: external torques (see `AddExternalTorque`) that end the task
    # while the arm moves, one per joint [N m]; null: no limits. Leave room for carried
    # objects: with a can, the fast kitchen's iiwa 14 feels up to 4 N m, at its wrist
    # 0.3 N m; with a cylinder, the five-axis arm feels 0.12 N m. Errors of the sensors
    # add to that. What an object meets at the very end of being set down is its goal.
    max_external_torque: list[float] | None = dc.field(
        default=None, metadata=positive()
    )
    # Time after a command within which the fingers may not have begun to move [s].
    gripper_reaction: float = dc.field(default=0.2, metadata={"ge": 0.0})
    # How long the fingers may take to close or open [s].
    gripper_timeout: float = dc.field(default=1.5, metadata=positive())
    # How long to check the grasp before and after lifting [s].
    verify_time: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # A carried object is lost once nothing has been sensed between the fingers for this
    # long [s]. It must be longer than `grasp_detector.post_contact_delay`, so that one
    # missed reading of a sensor does not count.
    slip_time: float = dc.field(default=0.15, metadata=positive())
    # It is also lost once the gripper's joints have closed by this much on average in
    # that time [rad]. Fingers around an object give way to one another, which does not
    # change the average: it changed by less than 0.001 rad with a can between
    # fingertips, and by 0.01 rad with wrapped fingers that settled. Fingers that lose a
    # can close by 0.1 rad.
    slip_closing: float = dc.field(default=0.03, metadata=positive())
    # Factor on the squeeze after an object has been lost or missed.
    regrasp_squeeze: float = dc.field(default=1.5, metadata={"ge": 1.0})
    # Whether to look again when the hand is in front of the object, and to plan again
    # if it has moved. Useful with cameras that see it there.
    look_before_grasp: bool = False
    # Whether to look for the object in the hand above the goal, and to plan its placing
    # from there. Useful with cameras that see it there.
    look_before_place: bool = False
    # Least waits of the arm [s]: with closed fingers before it lifts, with open fingers
    # before it leaves, and at home. When it has cleared a table, the last one counts
    # from when it let go.
    grip_wait: float = dc.field(default=0.0, metadata={"ge": 0.0})
    release_wait: float = dc.field(default=0.0, metadata={"ge": 0.0})
    home_wait: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Time for the empty fingers to close at home [s]; 0 leaves them open.
    close_at_home: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Whether an arm that clears a table cuts corners: it does not rest between two
    # motions then, and the second one must begin on time. So it does rest on a robot,
    # and where a safety monitor may slow it.
    cut_corners: bool = False
    # Time between evaluations of the state machine [s].
    period: float = dc.field(default=0.01, metadata=positive())
