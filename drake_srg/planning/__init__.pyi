from drake_srg.planning.clearing.clearing_planner import (
    ClearingPlanner as ClearingPlanner,
)
from drake_srg.planning.grasps.grasps import Grasp as Grasp
from drake_srg.planning.grasps.grasps import GraspSearch as GraspSearch
from drake_srg.planning.grasps.grasps import Hand as Hand
from drake_srg.planning.grasps.linkage_hand import LinkageHand as LinkageHand
from drake_srg.planning.grasps.srg_hand import SrgFingers as SrgFingers
from drake_srg.planning.grasps.srg_hand import SrgHand as SrgHand
from drake_srg.planning.grasps.top_grasps import HeightMapGrasps as HeightMapGrasps
from drake_srg.planning.grasps.top_grasps import TopGrasp as TopGrasp
from drake_srg.planning.motion.arm_model import ArmModel as ArmModel
from drake_srg.planning.motion.arm_motion import Motion as Motion
from drake_srg.planning.motion.inverse_kinematics import AxisTarget as AxisTarget
from drake_srg.planning.motion.inverse_kinematics import HandTarget as HandTarget
from drake_srg.planning.motion.inverse_kinematics import IkFailure as IkFailure
from drake_srg.planning.motion.inverse_kinematics import IkSolution as IkSolution
from drake_srg.planning.motion.inverse_kinematics import Requirement as Requirement
from drake_srg.planning.motion.inverse_kinematics import (
    solve_inverse_kinematics as solve_inverse_kinematics,
)
from drake_srg.planning.motion.limits import MotionConfig as MotionConfig
from drake_srg.planning.motion.limits import MotionLimits as MotionLimits
from drake_srg.planning.motion.moves import Moves as Moves
from drake_srg.planning.motion.paths import plan_cartesian_path as plan_cartesian_path
from drake_srg.planning.motion.paths import plan_joint_path as plan_joint_path
from drake_srg.planning.motion.planning_scene import Clearance as Clearance
from drake_srg.planning.motion.planning_scene import NoPathError as NoPathError
from drake_srg.planning.motion.planning_scene import PlanningFailure as PlanningFailure
from drake_srg.planning.motion.planning_scene import PlanningScene as PlanningScene
from drake_srg.planning.motion.trajectories import (
    time_optimal_trajectory as time_optimal_trajectory,
)
from drake_srg.planning.pick_and_place.knowledge import FATAL as FATAL
from drake_srg.planning.pick_and_place.knowledge import TRANSITIONS as TRANSITIONS
from drake_srg.planning.pick_and_place.knowledge import PlannerMemory as PlannerMemory
from drake_srg.planning.pick_and_place.modes import Carrying as Carrying
from drake_srg.planning.pick_and_place.modes import Moving as Moving
from drake_srg.planning.pick_and_place.modes import TaskMode as TaskMode
from drake_srg.planning.pick_and_place.modes import task_modes as task_modes
from drake_srg.planning.pick_and_place.planner import (
    PickAndPlacePlanner as PickAndPlacePlanner,
)
from drake_srg.planning.pick_and_place.task_motions import GraspMotions as GraspMotions
from drake_srg.planning.pick_and_place.task_motions import TaskMotions as TaskMotions
from drake_srg.planning.pick_and_place.task_motions import TaskPlanner as TaskPlanner
from drake_srg.planning.planner_machine import Clear as Clear
from drake_srg.planning.planner_machine import MotionMemory as MotionMemory
from drake_srg.planning.planner_machine import Observation as Observation
from drake_srg.planning.planner_machine import PickAndPlace as PickAndPlace
from drake_srg.planning.planner_machine import PlannerConfig as PlannerConfig
from drake_srg.planning.planner_machine import PlannerMachine as PlannerMachine
from drake_srg.planning.planner_machine import PlannerMode as PlannerMode
from drake_srg.planning.planner_machine import Table as Table
from drake_srg.planning.planner_machine import Transitions as Transitions
from drake_srg.planning.servoing.config import ServoConfig as ServoConfig
from drake_srg.planning.servoing.config import ServoingConfig as ServoingConfig
from drake_srg.planning.servoing.tracker import SilhouetteTracker as SilhouetteTracker
from drake_srg.planning.servoing.tracker import SurfaceTracker as SurfaceTracker
from drake_srg.planning.servoing.visual_servo import ImageBasedServo as ImageBasedServo
from drake_srg.planning.servoing.visual_servo import (
    PositionBasedServo as PositionBasedServo,
)
from drake_srg.planning.state_machine import Entry as Entry
from drake_srg.planning.state_machine import Memory as Memory
from drake_srg.planning.state_machine import ModeActions as ModeActions
from drake_srg.planning.state_machine import Moment as Moment
from drake_srg.planning.state_machine import StateMachine as StateMachine
from drake_srg.planning.state_machine import next_mode as next_mode
