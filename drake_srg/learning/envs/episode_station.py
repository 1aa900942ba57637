"""A station that is built once and simulates one episode after another."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import ApplySimulatorConfig

from drake_srg.arm.driver import SetInterpolatedPosition
from drake_srg.common.exceptions import one_line
from drake_srg.common.systems import MakeSimulator, output_ports
from drake_srg.learning.envs.scenes import CONTROL_PERIOD, Scene
from drake_srg.objects.models import SetObject, X_FO_start, object_body
from drake_srg.scenario import Scenario, is_continuous
from drake_srg.station import MakeStation
from drake_srg.station.held_grasp import HeldGrasp, read_grasp
from drake_srg.station.perception import camera_models
from drake_srg.types import Vector
from drake_srg.vision.blob_localizer import BlobLocalizer, BlobTarget
from drake_srg.vision.color import ColorRange


class SimulationError(Exception):
    """Drake could not advance an episode; the message is one line."""


class EpisodeStation:
    """A station with a new object, arm posture and time in every episode.

    Only its context changes, so an episode does not depend on those before it.

    Args:
        scenario: Scenario with an arm, a gripper and the picked object.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """

    def __init__(self, scenario: Scenario) -> None:
        assert scenario.arm is not None
        self.scenario = scenario
        self.station = MakeStation(scenario)
        self.simulator = MakeSimulator(self.station, scenario.simulator_config)
        self.context = self.simulator.get_mutable_context()
        self.plant = self.station.GetSubsystemByName("plant")
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self._scene_graphs = [
            self.station.GetSubsystemByName(name)
            for name in ("scene_graph", "render_scene_graph")
            if self.station.HasSubsystemNamed(name)
        ]
        # The scene graphs are not reset, because `SetObject` overwrites everything in
        # them that changes. Copying their defaults would double the time of a reset.
        self._reset = [
            (system, system.GetMyMutableContextFromRoot(self.context))
            for system in self.station.GetSystems()
            if system not in self._scene_graphs
        ]
        self._new = self.plant.CreateDefaultContext()
        self._arm = self.plant.GetModelInstanceByName("arm")
        self._gripper = self.plant.GetModelInstanceByName("gripper")
        self._pick = scenario.task.pick
        self._model = self.plant.GetModelInstanceByName(self._pick)
        self._body = object_body(self.plant, self._model)
        self._object = self.plant.get_body(self._body)
        self._interpolator = self.station.GetSubsystemByName(
            "arm_driver"
        ).GetSubsystemByName("interpolator")
        self._outputs = output_ports(self.station)
        n = self.plant.num_positions(self._arm)
        self._arm_command = self._fix("arm.position_commanded", np.zeros(n))
        self._closure_command = self._fix("gripper.closure_commanded", np.zeros(1))
        self._ticks = 0

    def _fix(self, name: str, value: Vector) -> Callable[[Vector], None]:
        """Fix an input port, and return a function that sets it."""
        fixed = self.station.GetInputPort(name).FixValue(self.context, value)

        def set_value(new: Vector) -> None:
            fixed.GetMutableData().get_mutable_value().SetFromVector(new)

        return set_value

    def reset(self, scene: Scene, q: Vector) -> None:
        """Begin an episode.

        Args:
            scene: The object and its place.
            q: Positions of the arm's joints, shape (N,), held until the first command.
        """
        self._forget()
        # The second scene graph serves only the cameras.
        for scene_graph in self._scene_graphs[: 2 if self.scenario.cameras else 1]:
            SetObject(self.plant, scene_graph, self.context, self._body, scene.object)
        height = self.scenario.table.height
        self._begin(X_FO_start(scene.object, scene.shape, height), q)

    def reset_to(
        self, X_WO: RigidTransform, q: Vector, fingers: Mapping[str, float]
    ) -> None:
        """Begin an episode with the scenario's own object anywhere.

        Args:
            X_WO: Its pose in world [m].
            q: Positions of the arm's joints, shape (N,), held until the first command.
            fingers: Angles of the gripper's joints by name [rad].
        """
        self._forget()
        for name, angle in fingers.items():
            joint = self.plant.GetJointByName(name, self._gripper)
            joint.set_angle(self.plant_context, angle)
        self._begin(X_WO, q)

    def _forget(self) -> None:
        """Reset the context to its defaults, except for the scene graphs."""
        for system, context in self._reset:
            system.SetDefaultContext(context)
        # A discrete plant would keep the contacts of its last step.
        self.plant_context.SetStateAndParametersFrom(self._new)
        self.context.SetTime(0.0)
        self._ticks = 0

    def _begin(self, X_WO: RigidTransform, q: Vector) -> None:
        """Place the object, hold the arm, and initialize the simulator."""
        self.plant.SetFreeBodyPose(self.plant_context, self._object, X_WO)
        self.plant.SetPositions(self.plant_context, self._arm, q)
        SetInterpolatedPosition(self._interpolator, self.context, q)
        self._arm_command(q)
        self._closure_command(np.zeros(1))
        if is_continuous(self.scenario):
            # Otherwise, the integrator would begin with the last episode's step size.
            integrator = self.simulator.get_mutable_integrator()
            integrator.Reset()
            ApplySimulatorConfig(self.scenario.simulator_config, self.simulator)
        self.simulator.Initialize()

    def advance(self, q: Vector, closure: float) -> None:
        """Simulate one control period.

        Args:
            q: Commanded positions of the arm's joints, shape (N,).
            closure: Commanded closure, 0 .. 1.

        Raises:
            SimulationError: If Drake gives up, or the state is no longer finite.
        """
        self._arm_command(q)
        self._closure_command(np.array([closure]))
        self._ticks += 1
        try:
            self.simulator.AdvanceTo(self._ticks * CONTROL_PERIOD)
        except (RuntimeError, SystemExit) as error:
            raise SimulationError(one_line(error)) from error
        if not math.isfinite(sum(self.motion())):
            raise SimulationError("the object's pose is not finite any more")

    @property
    def time(self) -> float:
        """Simulated time since the episode began [s]."""
        return self._ticks * CONTROL_PERIOD

    def measured(self, name: str) -> Any:
        """Return the present value of an output port of the station."""
        return self._outputs[name].Eval(self.context)

    def q(self) -> Vector:
        """Return the true positions of the arm's joints, shape (N,)."""
        q: Vector = self.plant.GetPositions(self.plant_context, self._arm)
        return q

    def X_WO(self) -> RigidTransform:
        """Return the true pose of the object in world."""
        return self.plant.EvalBodyPoseInWorld(self.plant_context, self._object)

    def grasp(self) -> HeldGrasp:
        """Return the hand's grasp of the object."""
        return read_grasp(self.station, self.context, self._pick)

    def motion(self) -> list[float]:
        """Return position [m] and velocity [m/s] of the object's origin (6)."""
        # One call, and floats instead of arrays, because this runs every period.
        state = self.plant.GetPositionsAndVelocities(self.plant_context, self._model)
        values: list[float] = state.tolist()
        return values[4:7] + values[10:13]


_PORTS = ("color_image", "depth_image", "body_pose_in_world")


class Sight:
    """Locates the object of each episode with a cell's localizer."""

    def __init__(self, scenario: Scenario) -> None:
        self._name = scenario.task.pick
        self._models = camera_models(scenario)
        self._config = scenario.localizer
        # All objects have the colour of the first one; see docs/learning.md.
        self._color = ColorRange.around(scenario.objects[self._name].color)

    def find(self, station: EpisodeStation, scene: Scene) -> Vector | None:
        """Return the pose [x, y, z, yaw] (4) of the object, None if it is not seen."""
        localizer = BlobLocalizer(
            [BlobTarget(self._name, scene.shape, self._color)],
            self._models,
            min_area=self._config.min_area,
        )
        context = localizer.CreateDefaultContext()
        for camera in self._models:
            for port in _PORTS:
                value = AbstractValue.Make(station.measured(f"camera_{camera}.{port}"))
                localizer.GetInputPort(f"{camera}.{port}").FixValue(context, value)
        blobs = localizer.get_output_port().Eval(context)
        if not blobs:
            return None
        X_WO = max(blobs, key=lambda blob: (blob.certain, blob.trust)).X_WO
        yaw = 0.0 if scene.is_round else RollPitchYaw(X_WO.rotation()).yaw_angle()
        return np.append(X_WO.translation(), yaw)
