"""The arm drivers that a scenario's tag selects from."""

import dataclasses as dc

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import DiagramBuilder

from drake_srg.arm.driver import AddActuation, ArmDriver, ArmSignals, arm_actuators
from drake_srg.arm.impedance import ArmImpedanceDriver


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
        actuators = arm_actuators(plant, arm)
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
        inner.ExportOutput(signals.desired, "desired_state")
        if signals.gravity is not None:
            AddActuation(inner, signals.gravity, self.period)


DRIVERS: tuple[type[ArmDriver], ...] = (ArmPositionDriver, ArmImpedanceDriver)
