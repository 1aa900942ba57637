"""A linkage gripper with a driver, and a cylinder on a table that goes down."""

import numpy as np
from helpers import fix
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.gripper import LinkageDriver
from drake_srg.gripper.drivers import AddGripperDriver
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, SetDefaultObjectPose
from drake_srg.parsing import AddModel
from drake_srg.types import Cylinder

PALM_TO_TIP = 0.095
LENGTH = 0.05  # of the cylinder [m]
ROCKER = np.array([0.0, 0.010, 0.0])  # rocker's pin to crank's, inwards [m]
TABLE = """
<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="table">
<link name="table"><collision name="c"><geometry><box><size>0.2 0.2 0.04</size></box>
</geometry><drake:proximity_properties><drake:rigid_hydroelastic/><drake:mu_dynamic>0.5
</drake:mu_dynamic><drake:mu_static>0.5</drake:mu_static></drake:proximity_properties>
</collision></link><joint name="lift" type="prismatic"><parent>world</parent>
<child>table</child><axis><xyz>0 0 1</xyz></axis></joint></model></sdf>"""


class Hand:
    """A gripper with its palm fixed and level, and a cylinder upright in the grasp."""

    def __init__(
        self,
        *,
        model="linkage_gripper",
        radius=None,
        offset=(0.0, 0.0),
        mass=0.02,
        friction=0.8,
        time_step=0.005,
        config=None,
    ):
        builder = DiagramBuilder()
        plant_config = MultibodyPlantConfig(
            time_step=time_step, discrete_contact_approximation="lagged"
        )
        self.plant, scene_graph = AddMultibodyPlant(plant_config, builder)
        parser = Parser(self.plant)
        self.model = AddModel(self.plant, f"package://drake_srg/sdf/{model}.sdf")
        palm = self.plant.GetFrameByName("palm", self.model)
        self.plant.WeldFrames(self.plant.world_frame(), palm)
        (table,) = parser.AddModelsFromString(TABLE, "sdf")
        actuator = self.plant.GetJointActuatorByName("lift")
        actuator.set_controller_gains(PdControllerGains(p=1e5, d=2e3))
        self.plant.GetJointByName("lift").set_default_translation(-LENGTH / 2 - 0.02)
        self.object = None
        if radius is not None:
            shape = Cylinder(radius, LENGTH)
            config_ = ObjectConfig(shape=shape, mass=mass, friction=friction)
            instance = AddObject(self.plant, "cylinder", config_)
            X_WO = RigidTransform([PALM_TO_TIP + offset[0], offset[1], 0.0])
            SetDefaultObjectPose(self.plant, instance, X_WO)
            (body,) = self.plant.GetBodyIndices(instance)
            self.object = self.plant.get_body(body)
        self.config = config or LinkageDriver()
        self.config.prepare_plant(self.plant, self.model)
        self.plant.Finalize()
        self.driver = AddGripperDriver(builder, self.plant, self.model, self.config)
        builder.Connect(
            scene_graph.get_query_output_port(),
            self.driver.GetInputPort("query_object"),
        )
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.root = self.simulator.get_mutable_context()
        self.context = self.driver.GetMyMutableContextFromRoot(self.root)
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.root)
        self._table = self.plant.get_desired_state_input_port(table)
        self.lower_table(0.0)
        self.log = {name: [] for name in ("time", "loop", "object", *_LOGGED)}
        self.command(closure_commanded=0.0)

    def lower_table(self, depth):
        state = [-LENGTH / 2 - 0.02 - depth, 0.0]
        self._table.FixValue(self.plant_context, state)

    def command(self, **inputs):
        fix(self.driver, self.context, **inputs)

    def read(self, name):
        return self.driver.GetOutputPort(name).Eval(self.context).copy()

    @property
    def q(self):
        return self.read("state_measured")[:2]

    def p_GO(self):
        return self.object.EvalPoseInWorld(self.plant_context).translation()

    def loop_error(self):
        """Return how far apart the halves of the couplers are at the pins [m]."""
        distances = []
        for finger in ("master", "slave"):
            X_GT, X_GC = (
                self.plant.GetBodyByName(f"{finger}_{link}").EvalPoseInWorld(
                    self.plant_context
                )
                for link in ("tip", "coupler")
            )
            for p_TP, p_CQ in ((-ROCKER, np.zeros(3)), (np.zeros(3), ROCKER)):
                distances.append(np.linalg.norm(X_GT @ p_TP - X_GC @ p_CQ))
        return np.max(distances)

    def advance(self, duration):
        """Let time pass, and log every 5 ms."""
        for _ in range(round(duration / 0.005)):
            self.simulator.AdvanceTo(self.root.get_time() + 0.005)
            self.log["time"].append(self.root.get_time())
            self.log["loop"].append(self.loop_error())
            if self.object is not None:
                self.log["object"].append(self.p_GO())
            for name in _LOGGED:
                self.log[name].append(self.read(name))

    def array(self, name):
        return np.array(self.log[name])


_LOGGED = ("state_measured", "proximity", "contact_force", "grasped", "pwm")
