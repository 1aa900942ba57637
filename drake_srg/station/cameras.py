"""The cameras of a scenario, and what they see."""

from __future__ import annotations

import copy

from pydrake.geometry import SceneGraph
from pydrake.lcm import DrakeLcm
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.rendering import MultibodyPositionToGeometryPose
from pydrake.systems.sensors import ApplyCameraConfig

from drake_srg.scenario import Scenario
from drake_srg.station.plant import AddDirectives, AddObjects
from drake_srg.vision.camera_errors import CameraErrors


def AddCameras(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    scenario: Scenario,
) -> dict[str, OutputPort]:
    """Add the cameras of a scenario, and return their ports by name.

    They see a scene graph of their own. In the plant's, the renderers would follow
    every step of the simulation, which costs as much as the bare plant; this one takes
    the plant's poses when somebody asks for an image. What is soft is in the plant's
    alone, and costs more than the renderers do: with soft objects, cameras see that.
    """
    if any(config.soft for config in scenario.objects.values()):
        return _AddSensors(builder, plant, scene_graph, scenario)
    # A clone knows the same geometry by the same ids, and is made in a tenth of the
    # time that the models would take to be parsed again.
    seen = builder.AddNamedSystem("render_scene_graph", scene_graph.Clone())
    builder.Connect(
        plant.get_geometry_pose_output_port(),
        seen.get_source_pose_port(plant.get_source_id()),
    )
    return _AddSensors(builder, plant, seen, scenario)


def MakeRemoteCameras(scenario: Scenario) -> Diagram:
    """Build a diagram of a scenario's cameras and their own scene, without a plant.

    .. pydrake_system::

        name: RemoteCameras
        input_ports:
        - state
        output_ports:
        - camera_NAME.color_image
        - camera_NAME.depth_image
        - camera_NAME.body_pose_in_world

    `state` is the state [q; v] of a plant that `MakePlant` made of the same scenario.
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
    for name, camera_config in scenario.cameras.items():
        config = copy.copy(camera_config)
        config.name = name
        ApplyCameraConfig(
            config=config,
            builder=builder,
            plant=plant,
            scene_graph=scene_graph,
            lcm=DrakeLcm("memq://null"),  # stands for no publishing
        )
        sensor = builder.GetSubsystemByName(f"rgbd_sensor_{name}")
        # Not by GetOutputPort: that, of a system that Drake made, keeps its builder
        # alive where the garbage collector cannot see it (Drake 1.51.1).
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
        ports |= {f"camera_{name}.{port}": source for port, source in seen.items()}
    return ports
