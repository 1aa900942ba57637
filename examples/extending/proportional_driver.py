"""A gripper driver of your own: base and tip move in a fixed proportion."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.systems.primitives import MatrixGain
from slip_sensor import SlipConfig

from drake_srg import Simulate, load_scenario
from drake_srg.gripper import (
    SRG_FINGERS,
    AddJointServos,
    FingerLayout,
    GripperControl,
    GripperDriver,
    GripperServoConfig,
    MinimumJerkReference,
    SrgPositionDriver,
)
from drake_srg.planning import SrgHand
from drake_srg.simulation import Result
from drake_srg.station import register_gripper


@dc.dataclass(kw_only=True)
class ProportionalDriver(GripperDriver):
    """Moves base and tip of each finger in a fixed proportion."""

    layout: ClassVar[FingerLayout] = SRG_FINGERS

    slip: SlipConfig = dc.field(default_factory=SlipConfig)
    full_scale: float = 2.5  # base plus tip angle at closure 1 [rad]
    base_share: float = 0.8
    servo: GripperServoConfig = dc.field(
        default_factory=lambda: SrgPositionDriver().servo
    )

    def AddControl(self, inner, plant, gripper, sensing):
        """Turn closure into joint torques."""
        base, tip = self.base_share, 1.0 - self.base_share
        gain = self.full_scale * np.array([[base], [base], [tip], [tip]])
        angles = inner.AddNamedSystem("joint_angles", MatrixGain(gain))
        reference = inner.AddNamedSystem(
            "minimum_jerk_reference", MinimumJerkReference(np.zeros(4))
        )
        inner.Connect(
            angles.get_output_port(), reference.GetInputPort("position_desired")
        )
        inner.Connect(sensing.state_measured, reference.GetInputPort("state_measured"))
        servos = AddJointServos(
            inner,
            plant,
            gripper,
            self.joint_names,
            self.servo,
            strength=1.0,
            state_measured=sensing.state_measured,
            reference=reference.get_output_port(),
        )
        inputs = {"closure_commanded": angles.get_input_port(), **servos.inputs}
        return GripperControl(inputs, servos.outputs)


def make_hand(driver, planner, plant):
    """Tell the planner how the gripper grasps."""
    return SrgHand(
        planner.approaches, planner.tilts, planner.squeeze, driver.full_scale
    )


register_gripper(ProportionalDriver, make_hand)


def main() -> Result:
    """Set the kitchen's can on its mark with this driver."""
    scenario = load_scenario("kitchen", overrides=["gripper=!ProportionalDriver {}"])
    return Simulate(scenario)


if __name__ == "__main__":
    print(main().metrics.table())
