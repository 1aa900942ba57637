from drake_srg.gripper.driver import AddFingerSensing as AddFingerSensing
from drake_srg.gripper.driver import FingerSensing as FingerSensing
from drake_srg.gripper.driver import GraspDetector as GraspDetector
from drake_srg.gripper.driver import GraspDetectorConfig as GraspDetectorConfig
from drake_srg.gripper.driver import GripperControl as GripperControl
from drake_srg.gripper.driver import GripperDriver as GripperDriver
from drake_srg.gripper.drivers import AddGripperDriver as AddGripperDriver
from drake_srg.gripper.joint_servos import AddJointServos as AddJointServos
from drake_srg.gripper.linkage_driver import LinkageDriver as LinkageDriver
from drake_srg.gripper.linkage_driver import MasterSlaveConfig as MasterSlaveConfig
from drake_srg.gripper.linkage_driver import (
    MasterSlaveReference as MasterSlaveReference,
)
from drake_srg.gripper.plant_servo_driver import PlantServoDriver as PlantServoDriver
from drake_srg.gripper.sensors import LINKAGE_FINGERS as LINKAGE_FINGERS
from drake_srg.gripper.sensors import SRG_FINGERS as SRG_FINGERS
from drake_srg.gripper.sensors import ContactForceSensors as ContactForceSensors
from drake_srg.gripper.sensors import FingerLayout as FingerLayout
from drake_srg.gripper.sensors import FingerSensorConfig as FingerSensorConfig
from drake_srg.gripper.sensors import ProximityConfig as ProximityConfig
from drake_srg.gripper.sensors import ProximitySensors as ProximitySensors
from drake_srg.gripper.sensors import TouchConfig as TouchConfig
from drake_srg.gripper.servo import GripperServo as GripperServo
from drake_srg.gripper.servo import GripperServoConfig as GripperServoConfig
from drake_srg.gripper.servo import MinimumJerkConfig as MinimumJerkConfig
from drake_srg.gripper.servo import MinimumJerkReference as MinimumJerkReference
from drake_srg.gripper.srg_position_driver import SrgPositionDriver as SrgPositionDriver
from drake_srg.gripper.srg_tendon_driver import SetTendonDynamics as SetTendonDynamics
from drake_srg.gripper.srg_tendon_driver import SpoolCommand as SpoolCommand
from drake_srg.gripper.srg_tendon_driver import SpoolCommandConfig as SpoolCommandConfig
from drake_srg.gripper.srg_tendon_driver import SrgTendonDriver as SrgTendonDriver
from drake_srg.gripper.tendon import MotorTemperature as MotorTemperature
from drake_srg.gripper.tendon import MotorTemperatureConfig as MotorTemperatureConfig
from drake_srg.gripper.tendon import TendonDrive as TendonDrive
from drake_srg.gripper.tendon import TendonDriveConfig as TendonDriveConfig
from drake_srg.gripper.tendon import base_moment_arm as base_moment_arm
from drake_srg.gripper.tendon import tip_moment_arm as tip_moment_arm
from drake_srg.gripper.tendon import wire_travel as wire_travel
from drake_srg.gripper.underactuation import JOINT_NAMES as JOINT_NAMES
from drake_srg.gripper.underactuation import (
    UnderactuationConfig as UnderactuationConfig,
)
from drake_srg.gripper.underactuation import UnderactuationLogic as UnderactuationLogic
from drake_srg.gripper.underactuation import finger_targets as finger_targets
