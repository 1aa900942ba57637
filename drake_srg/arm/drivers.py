"""The arm drivers that a scenario's tag selects from."""

import dataclasses as dc

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Adder

from drake_srg.arm.driver import AddSampling, ArmDriver, ArmSignals
from drake_srg.arm.impedance import ArmImpedanceDriver
from drake_srg.common.systems import AddVelocityFeedforward, model_actuators


@dc.dataclass(kw_only=True)
class ArmPositionDriver(ArmDriver):
    """Stiff joint position control with gravity compensation.

    The gains stand for the iiwa's position mode, whose gains KUKA does not publish.
    Each joint gets kp = J w² and kd = 2 J w (critical) with w = 40 rad/s, where J is
    the joint's reflected rotor inertia (1.2 to 3.4 kg m²) plus the inertia of the links
    beyond it in a typical posture. With these gains, 10 N move the flange by less than
    1 mm. The plant solves this stiff law implicitly, within its effort limits.
    """

    kp: list[float] = dc.field(
        default_factory=lambda: [
            *(9600.0, 9600.0, 7200.0, 7200.0, 2400.0, 2000.0, 1900.0)
        ],
        metadata={"ge": 0.0},
    )  # N m / rad
    kd: list[float] = dc.field(
        default_factory=lambda: [480.0, 480.0, 360.0, 360.0, 120.0, 100.0, 95.0],
        metadata={"ge": 0.0},
    )  # N m s / rad

    def prepare_plant(self, plant: MultibodyPlant, arm: ModelInstanceIndex) -> None:
        """See `ArmDriver`; gives the arm's actuators the driver's gains."""
        super().prepare_plant(plant, arm)
        actuators = model_actuators(plant, arm)
        self.check_length("kp", self.kp, len(actuators))
        self.check_length("kd", self.kd, len(actuators))
        for actuator, kp, kd in zip(actuators, self.kp, self.kd, strict=True):
            actuator.set_controller_gains(PdControllerGains(p=kp, d=kd))

    def AddControl(
        self,
        inner: DiagramBuilder,
        control_plant: MultibodyPlant,
        arm: str,
        signals: ArmSignals,
    ) -> None:
        """See `ArmDriver`."""
        desired, torques = signals.desired, []
        if signals.continuous:
            kd = np.array(self.kd)
            desired, torque = AddVelocityFeedforward(inner, desired, kd)
            torques.append(torque)
        if signals.gravity is not None:
            torques.append(AddSampling(inner, signals.gravity, self.period))
        inner.ExportOutput(desired, "desired_state")
        if torques:
            inner.ExportOutput(_AddSum(inner, torques), "actuation")


def _AddSum(inner: DiagramBuilder, torques: list[OutputPort]) -> OutputPort:
    """Return the sum of one or more torques."""
    if len(torques) == 1:
        return torques[0]
    size = torques[0].size()
    adder = inner.AddNamedSystem("torque", Adder(len(torques), size))
    for i, torque in enumerate(torques):
        inner.Connect(torque, adder.get_input_port(i))
    return adder.get_output_port()


DRIVERS: tuple[type[ArmDriver], ...] = (ArmPositionDriver, ArmImpedanceDriver)
