"""The cameras of a scenario, and the scene graph for their images."""

from __future__ import annotations

import copy

from pydrake.geometry import SceneGraph
from pydrake.lcm import DrakeLcm
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.rendering import MultibodyPositionToGeometryPose
from pydrake.systems.sensors import ApplyCameraConfig

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.installing import require_rendering
from drake_srg.scenario import Scenario
from drake_srg.station.plant import AddDirectives, AddObjects
from drake_srg.vision.camera import CalibratedPose
from drake_srg.vision.camera_errors import CameraErrors


def AddCameras(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    scenario: Scenario,
) -> dict[str, OutputPort]:
    """Add the cameras of a scenario, and return their output ports by name.

    The cameras render a scene graph of their own, which reads the plant's poses only
    when an image is evaluated. In the plant's scene graph, the renderers would follow
    every step of the simulation, which takes as long as the bare plant. With soft
    objects, which exist only in the plant's scene graph, the cameras render that one:
    there, the renderers' time matters less.
    """
    if any(config.soft for config in scenario.objects.values()):
        return _AddSensors(builder, plant, scene_graph, scenario)
    # A clone has the same geometry with the same ids, in a tenth of the time that
    # parsing the models again would take.
    seen = builder.AddNamedSystem("render_scene_graph", scene_graph.Clone())
    builder.Connect(
        plant.get_geometry_pose_output_port(),
        seen.get_source_pose_port(plant.get_source_id()),
    )
    return _AddSensors(builder, plant, seen, scenario)


def MakeRemoteCameras(scenario: Scenario) -> Diagram:
    """Build a diagram of cameras that render a plant simulated elsewhere.

    .. pydrake_system::

        name: RemoteCameras
        input_ports:
        - state
        output_ports:
        - camera_NAME.color_image
        - camera_NAME.depth_image
        - camera_NAME.body_pose_in_world

    `state` is the state [q; v] of a plant from `AddPlant` for the same scenario.
    """
    builder = DiagramBuilder()
    scene_graph = builder.AddNamedSystem("render_scene_graph", SceneGraph())
    plant = MultibodyPlant(time_step=0.0)
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    AddDirectives(plant, scenario)
    AddObjects(plant, scenario)
    plant.Finalize()
    poses = builder.AddNamedSystem(
        "render_poses",
        MultibodyPositionToGeometryPose(plant, input_multibody_state=True),
    )
    builder.Connect(
        poses.get_output_port(),
        scene_graph.get_source_pose_port(plant.get_source_id()),
    )
    builder.ExportInput(poses.get_input_port(), "state")
    for name, port in _AddSensors(builder, plant, scene_graph, scenario).items():
        builder.ExportOutput(port, name)
    return builder.Build()


def _AddSensors(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    scenario: Scenario,
) -> dict[str, OutputPort]:
    ports: dict[str, OutputPort] = {}
    if scenario.cameras:
        require_rendering()
    # The first camera of a renderer defines it, so begin with those that do.
    cameras = sorted(scenario.cameras.items(), key=lambda c: c[1].renderer_class == "")
    for name, camera_config in cameras:
        config = copy.copy(camera_config)
        config.name = name
        ApplyCameraConfig(
            config=config,
            builder=builder,
            plant=plant,
            scene_graph=scene_graph,
            lcm=DrakeLcm("memq://null"),  # publishes nothing
        )
        sensor = builder.GetSubsystemByName(f"rgbd_sensor_{name}")
        # Not GetOutputPort: for a system that Drake made, the result keeps the builder
        # alive, unseen by the garbage collector (Drake 1.51.1).
        seen = {
            "color_image": sensor.color_image_output_port(),
            "depth_image": sensor.depth_image_32F_output_port(),
            "body_pose_in_world": sensor.body_pose_in_world_output_port(),
        }
        if name in scenario.camera_errors:
            depth = sensor.default_depth_render_camera().core().intrinsics()
            errors = builder.AddNamedSystem(
                f"camera_errors_{name}",
                CameraErrors(
                    scenario.camera_errors[name],
                    focal=depth.focal_x(),
                    seed=scenario.random_seed,
                    name=name,
                ),
            )
            for port, source in seen.items():
                builder.Connect(source, errors.GetInputPort(port))
                seen[port] = errors.GetOutputPort(port)
        if name in scenario.camera_calibrations:
            true = sensor.body_pose_in_world_output_port()
            seen["body_pose_in_world"] = _AddCalibration(builder, scenario, name, true)
        ports |= {f"camera_{name}.{port}": source for port, source in seen.items()}
    return ports


def _AddCalibration(
    builder: DiagramBuilder, scenario: Scenario, name: str, true: OutputPort
) -> OutputPort:
    """Add a camera's CalibratedPose and return the port of the calibrated pose."""
    X_PB = scenario.cameras[name].X_PB
    calibrated = scenario.camera_calibrations[name].X_PB
    frames = [pose.base_frame or "world" for pose in (X_PB, calibrated)]
    if frames[0] != frames[1]:
        raise ScenarioError(
            f"camera_calibrations.{name}.X_PB.base_frame: must be that of "
            f"cameras.{name}, {frames[0]}, got {frames[1]}"
        )
    system = builder.AddNamedSystem(
        f"calibrated_pose_{name}",
        CalibratedPose(
            X_PB.GetDeterministicValue(), calibrated.GetDeterministicValue()
        ),
    )
    builder.Connect(true, system.get_input_port())
    return system.get_output_port()
