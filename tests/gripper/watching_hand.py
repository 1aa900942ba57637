"""A gripper with proximity sensors alone, and a ball to see."""

import numpy as np
from helpers import read, update
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from drake_srg.gripper.sensors import ProximityConfig
from drake_srg.parsing import AddModel

RADIUS = 0.01  # of the ball [m]


class Hand:
    """A gripper with its palm at the origin and a ball of 10 mm radius."""

    def __init__(self, file, layout, **config):
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        inertia = SpatialInertia.SolidSphereWithMass(1, 1)
        self.ball = self.plant.AddRigidBody("ball", inertia)
        self.plant.RegisterCollisionGeometry(
            self.ball,
            RigidTransform(),
            Sphere(RADIUS),
            "ball",
            CoulombFriction(1.0, 1.0),
        )
        model = AddModel(self.plant, f"package://drake_srg/sdf/{file}.sdf")
        palm = self.plant.GetFrameByName("palm")
        self.plant.WeldFrames(self.plant.world_frame(), palm)
        self.plant.Finalize()
        self.links = [
            self.plant.GetBodyByName(link, model)
            for link in layout.sensor_links.values()
        ]
        self.sensors = ProximityConfig(**config).AddSensor(
            builder, self.plant, model, layout
        )
        builder.Connect(
            scene_graph.get_query_output_port(), self.sensors.get_input_port()
        )
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.context = self.sensors.GetMyMutableContextFromRoot(self.root)

    def readings(self, p_WB=(0.0, 0.0, 1.0)):
        """Return the distances with the ball at a point, by default far away."""
        X_WB = RigidTransform(np.array(p_WB))
        self.plant.SetFreeBodyPose(self.plant_context, self.ball, X_WB)
        update(self.sensors, self.context)
        return read(self.sensors, self.context, "proximity")

    def beside(self, i, p_LB):
        """Return the reading of sensor i with the ball at a point of its link."""
        X_WL = self.links[i].EvalPoseInWorld(self.plant_context)
        return self.readings(X_WL @ np.array(p_LB))[i]
