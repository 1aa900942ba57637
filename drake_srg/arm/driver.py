"""Arm drivers: the base class, with interpolation and gravity, and position control."""

import abc
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
    OutputPort,
)
from pydrake.systems.primitives import (
    Adder,
    LinearSystem,
    Multiplexer,
    PassThrough,
    StateInterpolatorWithDiscreteDerivative,
    ZeroOrderHold,
)

from drake_srg.arm.reference import JerkLimitedReference, JerkLimits
from drake_srg.common.joint_errors import ArmErrorsConfig, CommandErrors, EncoderErrors
from drake_srg.common.systems import (
    AddUnique,
    AddVelocityFeedforward,
    check_prepared,
    model_actuators,
)
from drake_srg.config import Config, positive
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

_TICKS = 10_000  # number of command times that must coincide with steps


def AddLinearInterpolation(
    builder: DiagramBuilder, start: Vector, command_period: float, period: float
) -> Diagram:
    """Add `interpolator`, which moves evenly from one position command to the next.

    .. pydrake_system::

        name: Interpolation
        input_ports:
        - position
        output_ports:
        - state

    `position` (N) is sampled every `command_period`. In the period after a sample,
    `state` (2N), [q; v], moves from the previous sample to it, in steps of `period`.

    Args:
        builder: Builder of the diagram.
        start: Positions at the start, shape (N,).
        command_period: Time between commands [s].
        period: Time between steps of the output [s].

    Raises:
        ValueError: If the times of steps and commands do not coincide. The position is
            a sum of steps, so it would drift.
    """
    ratio, ticks = round(command_period / period), np.arange(_TICKS)
    if ratio < 1 or np.any(ticks * command_period != ticks * ratio * period):
        raise ValueError(
            f"arm.command_period: must be a multiple of arm.period ({period}) whose "
            "times are exact in binary, such as multiples of 1/1024, "
            f"got {command_period}"
        )
    inner = DiagramBuilder()
    n = len(start)
    eye = np.eye(n)
    # Its state is the last two commands. The speed is their difference per period.
    none = np.zeros((n, n))
    speed = inner.AddNamedSystem(
        "speed",
        LinearSystem(
            A=np.block([[none, none], [eye, none]]),
            B=np.vstack([eye, none]),
            C=np.hstack([eye, -eye]) / command_period,
            D=none,
            time_period=command_period,
        ),
    )
    speed.configure_default_state(np.tile(start, 2))
    inner.ExportInput(speed.get_input_port(), "position")
    position = inner.AddNamedSystem(
        "position",
        LinearSystem(A=eye, B=period * eye, C=eye, D=none, time_period=period),
    )
    position.configure_default_state(start)
    inner.Connect(speed.get_output_port(), position.get_input_port())
    state = inner.AddNamedSystem("state", Multiplexer([n, n]))
    inner.Connect(position.get_output_port(), state.get_input_port(0))
    inner.Connect(speed.get_output_port(), state.get_input_port(1))
    inner.ExportOutput(state.get_output_port(), "state")
    return builder.AddNamedSystem("interpolator", inner.Build())


def SetInterpolatedPosition(
    interpolator: Diagram, context: Context, position: Vector
) -> None:
    """Set the output of `AddLinearInterpolation` to a position at rest.

    Args:
        interpolator: The diagram.
        context: A mutable context that contains it.
        position: Position of the joints, shape (N,).
    """
    for name, state in (("speed", np.tile(position, 2)), ("position", position)):
        system = interpolator.GetSubsystemByName(name)
        system.GetMyMutableContextFromRoot(context).SetDiscreteState(state)


class GravityCompensation(LeafSystem):
    """Computes the torques that hold an arm against gravity.

    .. pydrake_system::

        name: GravityCompensation
        input_ports:
        - MODEL_state (each model)
        output_ports:
        - torque

    The inputs are the states [q; v] of the model instances `models`, in the order of
    the plant's state output ports. `torque` (N) [N m] is for the first model, in the
    order of its velocities. Pydrake's InverseDynamics computes the same but does not
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
        numbers = np.arange(plant.num_positions(), dtype=float)
        self._where = [  # indices of each model's positions among all
            plant.GetPositionsFromArray(model, numbers).astype(int)
            for model in self._models
        ]
        self.DeclareVectorOutputPort(
            name="torque",
            size=plant.num_velocities(self._models[0]),
            calc=self._calc_torque,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def _calc_torque(self, context: Context, output: BasicVector) -> None:
        q = np.zeros(self._plant.num_positions())
        for where, state in zip(self._where, self._states, strict=True):
            q[where] = state.Eval(context)[: len(where)]
        self._plant.SetPositions(self._plant_context, q)
        forces = self._plant.CalcGravityGeneralizedForces(self._plant_context)
        output.SetFromVector(
            -self._plant.GetVelocitiesFromArray(self._models[0], forces)
        )


# Natural frequency of a stiff arm [rad/s], and the least position error at which a
# motor may give its full torque [rad or m].
_FREQUENCY = 40.0
_FULL_TORQUE_ERROR = 0.01


def stiff_gains(
    plant: MultibodyPlant, arm: ModelInstanceIndex, home: Vector
) -> tuple[Vector, Vector]:
    """Return gains that hold an arm stiffly, from its inertia and its motors' limits.

    Each joint gets kp = J w² with w = 40 rad/s, but at most its effort limit over 0.01
    rad (or m), and kd = 2 sqrt(kp J), which is critical damping. J is the inertia that
    the joint moves at home: its motor's reflected inertia and all links beyond the
    joint, including the gripper.

    Args:
        plant: Finalized plant with the arm and what it carries.
        arm: The arm's model instance.
        home: Positions of the joints, shape (N,) [rad or m].

    Returns:
        kp [N m/rad or N/m] and kd [N m s/rad or N s/m], shape (N,) each.
    """
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, arm, home)
    inertia = np.diag(plant.CalcMassMatrix(context))
    joints = [actuator.joint() for actuator in model_actuators(plant, arm)]
    J = np.array([inertia[joint.velocity_start()] for joint in joints])
    limits = np.array([a.effort_limit() for a in model_actuators(plant, arm)])
    kp = np.minimum(J * _FREQUENCY**2, limits / _FULL_TORQUE_ERROR)
    return kp, 2.0 * np.sqrt(kp * J)


@dc.dataclass(frozen=True)
class ArmSignals:
    """Signals from which a driver's control computes torques.

    Attributes:
        desired: Desired state [q; v] (2N), updated every `period`.
        measured: Measured state [q; v] (2N).
        gravity: Torques that hold arm and gripper (N) [N m]; None if weightless.
        effort_limits: The motors' largest torques (N) [N m].
        continuous: Whether the plant has no time step.
    """

    desired: OutputPort
    measured: OutputPort
    gravity: OutputPort | None
    effort_limits: Vector
    continuous: bool


@dc.dataclass(kw_only=True)
class ArmDriver(Config, abc.ABC):
    """Configuration of an arm driver, which turns joint positions into motion.

    A driver derives from this class and implements `AddControl`.
    """

    # Joint positions at the start of a simulation [rad].
    home: list[float] = dc.field(default_factory=lambda: [0.0] * 7)
    # Period at which commands are sampled and torques are computed [s].
    period: float = dc.field(default=0.005, metadata=positive())
    # Whether the joints have servos on a bus, which `drake-srg serve --servo` emulates.
    bus_servos: bool = False
    # Time between commands [s], a multiple of `period`. The arm moves evenly from one
    # command to the next, with a delay of this time. Null: the arm follows every
    # command at once.
    command_period: float | None = dc.field(default=None, metadata=positive())
    # Whether the arm has no weight, so that the driver need not compensate for it every
    # `period`. The gripper's weight then deflects the joints: the iiwa's hand by 0.4
    # mm.
    weightless: bool = False
    # Limits of the motion to targets that may jump; see `AddJerkLimits`. Null: there
    # are none, and the arm follows a stream of targets or trajectories directly; see
    # `TrajectoryFollower`.
    limits: JerkLimits | None = dc.field(default_factory=JerkLimits)
    # Largest torque of the motors, as a fraction of the model's effort limit.
    motor_strength: float = dc.field(default=1.0, metadata=positive())
    errors: ArmErrorsConfig = dc.field(default_factory=ArmErrorsConfig)

    def prepare_plant(self, plant: MultibodyPlant, arm: ModelInstanceIndex) -> None:
        """Prepare the plant for the driver, before the plant is finalized.

        The arm starts at `home`.

        Raises:
            ValueError: If a list does not have one entry per actuated joint of the arm.
        """
        actuators = model_actuators(plant, arm)
        self.check_length("home", self.home, len(actuators))
        for actuator, q in zip(actuators, self.home, strict=True):
            actuator.joint().set_default_positions([q])
            limit = self.motor_strength * actuator.effort_limit()
            actuator.set_effort_limit(limit)
        if self.weightless:
            plant.set_gravity_enabled(arm, False)

    def SetGains(self, plant: MultibodyPlant, arm: ModelInstanceIndex) -> None:
        """Set the gains of an arm's actuators, if the driver uses gains.

        Raises:
            ValueError: If `prepare_plant` was not called.
        """
        if self.weightless and plant.is_gravity_enabled(arm):
            raise ValueError(
                f"{plant.GetModelInstanceName(arm)}: has weight: call the "
                "configuration's prepare_plant before the plant is finalized"
            )

    @staticmethod
    def check_length(key: str, values: list[float], n: int) -> None:
        """Check that `arm.KEY` has one entry for each of the arm's `n` joints.

        Raises:
            ValueError: If it has another number of entries.
        """
        if len(values) != n:
            raise ValueError(
                f"arm.{key}: needs one entry per actuated joint of the arm "
                f"({n}), got {len(values)}"
            )

    @abc.abstractmethod
    def AddControl(
        self,
        inner: DiagramBuilder,
        control_plant: MultibodyPlant,
        arm: str,
        signals: ArmSignals,
    ) -> None:
        """Add the control, and export `desired_state`, `actuation` or both.

        `desired_state` (2N), [q; v], is for PD actuators that `prepare_plant` has set
        up. If `signals.continuous`, pass it through `AddVelocityFeedforward`, because
        CENIC flips the sign of v. `actuation` (N) [N m] is added at the joints.

        Args:
            inner: The driver under construction.
            control_plant: A finalized plant with the arm and the gripper.
            arm: Name of the arm's model instance.
            signals: Signals that are already in `inner`.
        """


def AddArmDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    arm: ModelInstanceIndex,
    gripper: ModelInstanceIndex | None,
    control_plant: MultibodyPlant,
    config: ArmDriver,
    seed: int = 0,
    *,
    name: str = "arm_driver",
) -> Diagram:
    """Add the driver of an arm to a diagram and connect it to the (finalized) plant.

    .. pydrake_system::

        name: ArmDriver
        input_ports:
        - position_commanded
        - arm_state
        - gripper_state (with a gripper, unless weightless)
        output_ports:
        - desired_state (ArmPositionDriver)
        - actuation (unless ArmPositionDriver is weightless in a discrete plant)
        - state_measured

    `position_commanded` (N) [rad] becomes the desired state [q; v] of the driver's
    control. `desired_state` goes to the plant's PD actuators. `actuation` (N) [N m]
    adds torques: those that hold arm and gripper against gravity and, in a continuous
    plant, those of the desired velocities (which are then 0 in `desired_state`).
    `state_measured` (2N) is the arm's state [q; v] with the errors of `config.errors`.

    Args:
        builder: Builder of the diagram.
        plant: Plant with the arm, finalized after `config.prepare_plant`.
        arm: Its model instance.
        gripper: The model instance that the arm carries, if any.
        control_plant: A finalized plant with the arm, the gripper and no other moving
            body, for gravity.
        config: Configuration of the driver.
        seed: Seed of the errors.
        name: Name of the driver in the diagram; it must be unique.

    Raises:
        ValueError: If the name is taken, `prepare_plant` was not called, or the
            configuration does not fit the arm.
    """
    config.SetGains(plant, arm)
    inner = DiagramBuilder()
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
    names = {key: plant.GetModelInstanceName(model) for key, model in models.items()}
    gravity = None
    if not config.weightless:
        gravity = _AddGravityCompensation(inner, control_plant, names)
    signals = ArmSignals(
        interpolator.get_output_port(),
        measured.get_output_port(),
        gravity,
        np.array([a.effort_limit() for a in model_actuators(plant, arm)]),
        continuous=plant.time_step() == 0.0,
    )
    config.AddControl(inner, control_plant, names["arm"], signals)

    driver = AddUnique(builder, name, inner.Build())
    for key, model in models.items():
        if driver.HasInputPort(f"{key}_state"):
            builder.Connect(
                plant.get_state_output_port(model), driver.GetInputPort(f"{key}_state")
            )
    for port, command in (
        ("desired_state", plant.get_desired_state_input_port(arm)),
        ("actuation", plant.get_actuation_input_port(arm)),
    ):
        if driver.HasOutputPort(port):
            builder.Connect(driver.GetOutputPort(port), command)
    return driver


def _AddGravityCompensation(
    inner: DiagramBuilder, control_plant: MultibodyPlant, names: dict[str, str]
) -> OutputPort:
    """Add the gravity compensation to a driver that has the input `arm_state`.

    Args:
        inner: The driver under construction.
        control_plant: Plant with the models.
        names: Names of the models, the arm's first, by the prefixes of the driver's
            inputs for their states.

    Returns:
        The arm's torques.
    """
    gravity = inner.AddNamedSystem(
        "gravity_compensation", GravityCompensation(control_plant, [*names.values()])
    )
    for i, name in enumerate(names):
        if i == 0:
            inner.ConnectInput(f"{name}_state", gravity.get_input_port(i))
        else:
            inner.ExportInput(gravity.get_input_port(i), f"{name}_state")
    return gravity.get_output_port()


def AddSampling(inner: DiagramBuilder, torque: OutputPort, period: float) -> OutputPort:
    """Add a sampler every `period` [s] to a driver's torque, and return its port."""
    hold = inner.AddNamedSystem("zero_order_hold", ZeroOrderHold(period, torque.size()))
    inner.Connect(torque, hold.get_input_port())
    return hold.get_output_port()


@dc.dataclass(kw_only=True)
class ArmPositionDriver(ArmDriver):
    """Stiff joint position control with gravity compensation.

    The plant solves this law implicitly, within its effort limits.
    """

    # Gains, one per joint [N m/rad or N/m] and [N m s/rad or N s/m]. Null: gains from
    # the arm's inertia and motors; see `stiff_gains`.
    kp: list[float] | None = dc.field(default=None, metadata={"ge": 0.0})
    kd: list[float] | None = dc.field(default=None, metadata={"ge": 0.0})

    def prepare_plant(self, plant: MultibodyPlant, arm: ModelInstanceIndex) -> None:
        """Prepare the plant for the driver, before the plant is finalized.

        This makes the arm's actuators PD controllers.
        """
        super().prepare_plant(plant, arm)
        actuators = model_actuators(plant, arm)
        for key, gains in (("kp", self.kp), ("kd", self.kd)):
            if gains is not None:
                self.check_length(key, gains, len(actuators))
        for actuator in actuators:  # placeholders that `SetGains` replaces
            actuator.set_controller_gains(PdControllerGains(p=1.0, d=1.0))

    def SetGains(self, plant: MultibodyPlant, arm: ModelInstanceIndex) -> None:
        """Set the gains of an arm's actuators."""
        super().SetGains(plant, arm)
        check_prepared(plant, arm)
        kp, kd = self.gains(plant, arm)
        for i, actuator in enumerate(model_actuators(plant, arm)):
            actuator.set_controller_gains(PdControllerGains(p=kp[i], d=kd[i]))

    def gains(
        self, plant: MultibodyPlant, arm: ModelInstanceIndex
    ) -> tuple[Vector, Vector]:
        """Return kp and kd, shape (N,) each, for an arm in a finalized plant."""
        if self.kp is not None and self.kd is not None:
            return np.array(self.kp), np.array(self.kd)
        kp, kd = stiff_gains(plant, arm, np.array(self.home))
        kp = kp if self.kp is None else np.array(self.kp)
        return kp, kd if self.kd is None else np.array(self.kd)

    def AddControl(
        self,
        inner: DiagramBuilder,
        control_plant: MultibodyPlant,
        arm: str,
        signals: ArmSignals,
    ) -> None:
        """Add the control, and export `desired_state`, `actuation` or both."""
        desired, torques = signals.desired, []
        if signals.continuous:
            model = control_plant.GetModelInstanceByName(arm)
            _, kd = self.gains(control_plant, model)
            desired, torque = AddVelocityFeedforward(inner, desired, kd)
            torques.append(torque)
        if signals.gravity is not None:
            torques.append(AddSampling(inner, signals.gravity, self.period))
        inner.ExportOutput(desired, "desired_state")
        if torques:
            inner.ExportOutput(_AddSum(inner, torques), "actuation")


def _AddSum(inner: DiagramBuilder, torques: list[OutputPort]) -> OutputPort:
    """Return the sum of one or more torques, with an added system if there are more."""
    if len(torques) == 1:
        return torques[0]
    size = torques[0].size()
    adder = inner.AddNamedSystem("torque", Adder(len(torques), size))
    for i, torque in enumerate(torques):
        inner.Connect(torque, adder.get_input_port(i))
    return adder.get_output_port()


def AddJerkLimits(
    builder: DiagramBuilder, config: ArmDriver, name: str = "arm_reference"
) -> JerkLimitedReference:
    """Add a reference to a diagram, which turns jumping targets into smooth motion.

    It has the driver's limits and period. It starts at the driver's home or, if you
    connect its `state_measured`, at the arm's position. Connect its output
    `position_commanded` to the driver's input of that name.

    Args:
        builder: Builder of the diagram.
        config: Configuration of the driver.
        name: Name of the reference in the diagram.

    Raises:
        ValueError: If the name is taken, there are no limits, or a limit has neither
            one entry nor one entry per joint.
    """
    if config.limits is None:
        raise ValueError("arm.limits: must be given where targets jump")
    reference = JerkLimitedReference(
        np.array(config.home), config.limits, config.period
    )
    return AddUnique(builder, name, reference)
