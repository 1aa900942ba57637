"""A camera of your own and our localizer: where is the red box?"""

import numpy as np
from own_world import RED, AddBox, AddCamera
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import RgbdSensor

from drake_srg.types import Blob, Box
from drake_srg.vision import BlobLocalizer, BlobTarget, CameraModel, ColorRange


def AddLocalizer(
    builder: DiagramBuilder, scene_graph: SceneGraph, X_WB: RigidTransform, box: Box
) -> tuple[RgbdSensor, BlobLocalizer]:
    """Add a camera at X_WB [m] and a localizer that looks for a red box with it."""
    camera = AddCamera(builder, scene_graph, X_WB)
    target = BlobTarget("box", box, ColorRange.around(RED))
    model = CameraModel.from_sensor(camera)
    localizer = BlobLocalizer([target], {"eye": model})
    builder.AddNamedSystem("localizer", localizer)
    # The localizer asks for images only when somebody asks for blobs.
    for source, name in (
        (camera.color_image_output_port(), "color_image"),
        (camera.depth_image_32F_output_port(), "depth_image"),
        (camera.body_pose_in_world_output_port(), "body_pose_in_world"),
    ):
        builder.Connect(source, localizer.GetInputPort(f"eye.{name}"))
    return camera, localizer


def main() -> tuple[Blob, RigidTransform]:
    """Return what the localizer sees, and where the box is."""
    builder, box = DiagramBuilder(), Box([0.05, 0.06, 0.1])
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    X_WO = RigidTransform(RollPitchYaw(0.0, 0.0, 0.4), [0.1, -0.05, 0.05])
    AddBox(plant, "box", box.size, X_WO, RED, mass=0.3)
    AddBox(plant, "table", [1.0, 1.0, 0.1], RigidTransform([0.0, 0.0, -0.05]))
    plant.Finalize()
    # The camera looks down from the side: its z points into the scene.
    X_WB = RigidTransform(RollPitchYaw(-2.6, 0.0, 0.0), [0.0, -0.6, 1.0])
    _, localizer = AddLocalizer(builder, scene_graph, X_WB, box)
    context = builder.Build().CreateDefaultContext()
    port = localizer.GetOutputPort("blobs")
    blobs = port.Eval(localizer.GetMyContextFromRoot(context))
    return blobs[0], X_WO


if __name__ == "__main__":
    blob, X_WO = main()
    off = 1e3 * np.linalg.norm(blob.position - X_WO.translation())
    print(f"The box is at {blob.position.round(4)} m, {off:.2f} mm off.")
