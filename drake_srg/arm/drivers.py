"""The arm driver: from joint position commands to joint torques."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
)
from pydrake.systems.primitives import (
    PassThrough,
    StateInterpolatorWithDiscreteDerivative,
    ZeroOrderHold,
)

from drake_srg.arm.interpolation import AddLinearInterpolation
from drake_srg.arm.jerk_limited import JerkLimitedReference, JerkLimits
from drake_srg.common.fusing import FusingBuilder
from drake_srg.common.joint_errors import ArmErrorsConfig, CommandErrors, EncoderErrors
from drake_srg.lifetime import LeafSystem
from drake_srg.types import positive


@dc.dataclass(kw_only=True)
class ArmPositionDriver:
    """Stiff joint position control with gravity compensation.

    The gains stand for the iiwa's position mode, whose gains KUKA does not publish.
    Each joint gets kp = J w² and kd = 2 J w (critical) with w = 40 rad/s, where J is
    the joint's reflected rotor inertia (1.2 to 3.4 kg m²) plus the inertia of the links
    beyond it in a typical posture. With these gains, 10 N move the flange by less than
    1 mm.
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
    # Joint positions at the start of a simulation [rad].
    home: list[float] = dc.field(default_factory=lambda: [0.0] * 7)
    # Period at which commands are sampled and gravity is compensated [s].
    period: float = dc.field(default=0.005, metadata=positive())
    # Whether the joints have servos on a bus, which `drake-srg serve --servo` emulates.
    bus_servos: bool = False
    # Time between commands [s], a multiple of `period`: the arm moves evenly from one
    # to the next, one such time late. Null: it takes every command as it is.
    command_period: float | None = dc.field(default=None, metadata=positive())
    # Whether the arm has no weight, in place of compensating for it every `period`. The
    # gripper's weight then bends the joints: the iiwa's by 0.4 mm at the hand.
    weightless: bool = False
    # Limits of the motion to targets that may jump; see `AddJerkLimits`. Null: the arm
    # follows a stream of targets or trajectories as it is; see `TrajectoryFollower`.
    limits: JerkLimits | None = dc.field(default_factory=JerkLimits)
    # Largest torque of the motors, as a fraction of the model's effort limit.
    motor_strength: float = dc.field(default=1.0, metadata=positive())
    errors: ArmErrorsConfig = dc.field(default_factory=ArmErrorsConfig)
    # As `gripper.fused`: whether the stages of the errors run as one system.
    fused: bool = False


class GravityCompensation(LeafSystem):
    """Computes the torques that hold an arm against gravity.

    .. pydrake_system::

        name: GravityCompensation
        input_ports:
        - MODEL_state (each model)
        output_ports:
        - torque

    The inputs are the states [q; v] of the model instances `models`, in the order of
    the plant's state output ports. `torque` (N) [N m] belongs to the first model, in
    the order of its velocities. Pydrake's InverseDynamics does the same but does not
    keep its plant alive.

    Args:
        plant: A finalized plant with these models and no other moving body.
        models: Names of the model instances, the arm's first.
    """

    def __init__(self, plant: MultibodyPlant, models: Sequence[str]) -> None:
        super().__init__()
        self._plant = plant
        self._plant_context = plant.CreateDefaultContext()  # scratch, not state
        self._models = [plant.GetModelInstanceByName(name) for name in models]
        self._states = [
            self.DeclareVectorInputPort(
                name=f"{name}_state", size=plant.num_multibody_states(model)
            )
            for name, model in zip(models, self._models, strict=True)
        ]
        self.DeclareVectorOutputPort(
            name="torque",
            size=plant.num_velocities(self._models[0]),
            calc=self._calc_torque,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        for model, state in zip(self._models, self._states, strict=True):
            self._plant.SetPositionsAndVelocities(
                self._plant_context, model, state.Eval(context)
            )
        forces = self._plant.CalcGravityGeneralizedForces(self._plant_context)
        output.SetFromVector(
            -self._plant.GetVelocitiesFromArray(self._models[0], forces)
        )


def SetArmGains(
    plant: MultibodyPlant, arm: ModelInstanceIndex, config: ArmPositionDriver
) -> None:
    """Give the arm's actuators the driver's gains, before the plant is finalized.

    The plant then solves the stiff control law implicitly, within its effort limits.

    Raises:
        ValueError: If there is not one gain or home position per actuator.
    """
    actuators = [plant.get_joint_actuator(a) for a in plant.GetJointActuatorIndices()]
    actuators = [a for a in actuators if a.model_instance() == arm]
    for name in ("kp", "kd", "home"):
        if len(getattr(config, name)) != len(actuators):
            raise ValueError(
                f"arm.{name}: needs one entry per actuated joint of the arm "
                f"({len(actuators)}), got {len(getattr(config, name))}"
            )
    for actuator, kp, kd in zip(actuators, config.kp, config.kd, strict=True):
        actuator.set_controller_gains(PdControllerGains(p=kp, d=kd))
        if config.motor_strength != 1.0:
            actuator.set_effort_limit(config.motor_strength * actuator.effort_limit())


def AddArmPositionDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    arm: ModelInstanceIndex,
    gripper: ModelInstanceIndex | None,
    control_plant: MultibodyPlant,
    config: ArmPositionDriver | None = None,
    seed: int = 0,
) -> Diagram:
    """Add the driver of an arm to a diagram and connect it to the (finalized) plant.

    .. pydrake_system::

        name: ArmPositionDriver
        input_ports:
        - position_commanded
        - arm_state
        - gripper_state (with a gripper, unless weightless)
        output_ports:
        - desired_state
        - actuation (unless weightless)
        - state_measured

    `position_commanded` (N) [rad] becomes the desired state [q; v] of the plant's PD
    actuators. `actuation` (N) [N m] adds the torques that hold arm and gripper against
    gravity. `state_measured` (2N) is the arm's state [q; v] with the errors of
    `config.errors`.

    Args:
        builder: Of the diagram.
        plant: With the arm, finalized.
        arm: Its model instance.
        gripper: The model instance that it carries, if any.
        control_plant: A finalized plant with the arm, the gripper and no other moving
            body, for gravity.
        config: Of the driver.
        seed: Of the errors.
    """
    config = config or ArmPositionDriver()
    inner = FusingBuilder() if config.fused else DiagramBuilder()
    n = plant.num_positions(arm)
    if config.command_period is None:
        interpolator = inner.AddNamedSystem(
            "interpolator",
            StateInterpolatorWithDiscreteDerivative(
                n, config.period, suppress_initial_transient=True
            ),
        )
    else:
        interpolator = AddLinearInterpolation(
            inner, np.array(config.home), config.command_period, config.period
        )
    inner.ExportOutput(interpolator.get_output_port(), "desired_state")
    errors = config.errors
    if errors.encoder_noise or errors.backlash:
        measured = inner.AddNamedSystem(
            "encoders", EncoderErrors(n, errors, config.period, seed, "arm")
        )
    else:
        measured = inner.AddNamedSystem("encoders", PassThrough(2 * n))
    if errors.latency or errors.backlash:
        command = inner.AddNamedSystem(
            "command_errors",
            CommandErrors(n, errors.latency, errors.backlash, config.period),
        )
        inner.ExportInput(command.get_input_port(), "position_commanded")
        inner.Connect(command.GetOutputPort("delayed"), interpolator.get_input_port())
        if errors.backlash:
            inner.Connect(command.GetOutputPort("play"), measured.GetInputPort("play"))
    else:
        inner.ExportInput(interpolator.get_input_port(), "position_commanded")
    inner.ExportInput(measured.get_input_port(0), "arm_state")
    inner.ExportOutput(measured.get_output_port(), "state_measured")
    models = {"arm": arm} if gripper is None else {"arm": arm, "gripper": gripper}
    if not config.weightless:
        names = [plant.GetModelInstanceName(model) for model in models.values()]
        _AddGravityCompensation(inner, control_plant, names, [*models], config.period)

    driver = builder.AddNamedSystem("arm_driver", inner.Build())
    for name, model in models.items():
        if driver.HasInputPort(f"{name}_state"):
            builder.Connect(
                plant.get_state_output_port(model), driver.GetInputPort(f"{name}_state")
            )
    for name, command in (
        ("desired_state", plant.get_desired_state_input_port(arm)),
        ("actuation", plant.get_actuation_input_port(arm)),
    ):
        if driver.HasOutputPort(name):
            builder.Connect(driver.GetOutputPort(name), command)
    return driver


def _AddGravityCompensation(
    inner: DiagramBuilder,
    control_plant: MultibodyPlant,
    models: Sequence[str],
    ports: Sequence[str],
    period: float,
) -> None:
    """Add the sampled gravity compensation of the first of `models` to a driver.

    Args:
        inner: The driver under construction, with the input `arm_state`.
        control_plant: With these models.
        models: Names of the model instances in that plant.
        ports: What the driver's inputs of their states are named after.
        period: Sample time [s].
    """
    gravity = inner.AddNamedSystem(
        "gravity_compensation", GravityCompensation(control_plant, models)
    )
    for i, name in enumerate(ports):
        if i == 0:
            inner.ConnectInput(f"{name}_state", gravity.get_input_port(i))
        else:
            inner.ExportInput(gravity.get_input_port(i), f"{name}_state")
    n = gravity.get_output_port().size()
    hold = inner.AddNamedSystem("zero_order_hold", ZeroOrderHold(period, n))
    inner.Connect(gravity.get_output_port(), hold.get_input_port())
    inner.ExportOutput(hold.get_output_port(), "actuation")


def AddJerkLimits(
    builder: DiagramBuilder, config: ArmPositionDriver
) -> JerkLimitedReference:
    """Add `arm_reference`, which makes motion of targets that jump, to a diagram.

    It starts at the driver's home and has the driver's limits and period. Connect its
    `position_commanded` to the driver's.

    Raises:
        ValueError: If there are no limits, or a limit has neither one entry nor one
            entry per joint.
    """
    if config.limits is None:
        raise ValueError("arm.limits: must be given where targets jump")
    return builder.AddNamedSystem(
        "arm_reference",
        JerkLimitedReference(np.array(config.home), config.limits, config.period),
    )
