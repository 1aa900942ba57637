from drake_srg.arm.driver import AddArmDriver as AddArmDriver
from drake_srg.arm.driver import AddJerkLimits as AddJerkLimits
from drake_srg.arm.driver import ArmDriver as ArmDriver
from drake_srg.arm.driver import ArmPositionDriver as ArmPositionDriver
from drake_srg.arm.driver import ArmSignals as ArmSignals
from drake_srg.arm.driver import GravityCompensation as GravityCompensation
from drake_srg.arm.external_torque import AddExternalTorque as AddExternalTorque
from drake_srg.arm.external_torque import (
    ExternalTorqueObserver as ExternalTorqueObserver,
)
from drake_srg.arm.impedance import ArmImpedanceDriver as ArmImpedanceDriver
from drake_srg.arm.impedance import CartesianStiffness as CartesianStiffness
from drake_srg.arm.impedance import ImpedanceControl as ImpedanceControl
from drake_srg.arm.reference import JerkLimitedReference as JerkLimitedReference
from drake_srg.arm.reference import JerkLimits as JerkLimits
from drake_srg.arm.reference import TrajectoryFollower as TrajectoryFollower
from drake_srg.arm.reference import trajectory_piece as trajectory_piece
from drake_srg.arm.safety.config import SafetyConfig as SafetyConfig
from drake_srg.arm.safety.monitor import AddSafetyMonitor as AddSafetyMonitor
from drake_srg.arm.safety.monitor import SafetyMonitor as SafetyMonitor
from drake_srg.common.joint_errors import ArmErrorsConfig as ArmErrorsConfig
