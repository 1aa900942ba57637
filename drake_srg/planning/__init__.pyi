from drake_srg.planning.clearing.clearing_planner import (
    ClearingPlanner as ClearingPlanner,
)
from drake_srg.planning.grasps.grasps import Grasp as Grasp
from drake_srg.planning.grasps.grasps import Hand as Hand
from drake_srg.planning.grasps.linkage_hand import LinkageHand as LinkageHand
from drake_srg.planning.grasps.srg_hand import SrgFingers as SrgFingers
from drake_srg.planning.grasps.srg_hand import SrgHand as SrgHand
from drake_srg.planning.grasps.top_grasps import HeightMapGrasps as HeightMapGrasps
from drake_srg.planning.motion.inverse_kinematics import HandTarget as HandTarget
from drake_srg.planning.motion.inverse_kinematics import (
    solve_inverse_kinematics as solve_inverse_kinematics,
)
from drake_srg.planning.motion.planning_scene import NoPathError as NoPathError
from drake_srg.planning.motion.planning_scene import PlanningFailure as PlanningFailure
from drake_srg.planning.motion.planning_scene import PlanningScene as PlanningScene
from drake_srg.planning.pick_and_place.knowledge import FATAL as FATAL
from drake_srg.planning.pick_and_place.knowledge import TRANSITIONS as TRANSITIONS
from drake_srg.planning.pick_and_place.modes import Carrying as Carrying
from drake_srg.planning.pick_and_place.modes import Moving as Moving
from drake_srg.planning.pick_and_place.modes import task_modes as task_modes
from drake_srg.planning.pick_and_place.planner import (
    PickAndPlacePlanner as PickAndPlacePlanner,
)
from drake_srg.planning.pick_and_place.sightings import PickTask as PickTask
from drake_srg.planning.pick_and_place.task_motions import TaskPlanner as TaskPlanner
from drake_srg.planning.planner_machine import PickAndPlace as PickAndPlace
from drake_srg.planning.planner_machine import PlannerConfig as PlannerConfig
from drake_srg.planning.planner_machine import Transitions as Transitions
from drake_srg.planning.servoing.tracker import SilhouetteTracker as SilhouetteTracker
from drake_srg.planning.servoing.tracker import SurfaceTracker as SurfaceTracker
from drake_srg.planning.servoing.visual_servo import ImageBasedServo as ImageBasedServo
from drake_srg.planning.servoing.visual_servo import (
    PositionBasedServo as PositionBasedServo,
)
from drake_srg.planning.state_machine import Memory as Memory
from drake_srg.planning.state_machine import ModeActions as ModeActions
from drake_srg.planning.state_machine import StateMachine as StateMachine
from drake_srg.planning.state_machine import next_mode as next_mode
