"""Grippers with drivers, their palms fixed and level, and things to hold."""

import numpy as np
from helpers import fix
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.gripper import LinkageDriver, SrgPositionDriver
from drake_srg.gripper.drivers import AddGripperDriver
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, SetDefaultObjectPose
from drake_srg.parsing import AddModel
from drake_srg.types import Cylinder


class DrivenHand:
    """A gripper with a driver, and a log of some of the driver's outputs."""

    log_period: float  # s
    logged: tuple[str, ...]

    def __init__(self, file, config, time_step):
        builder = DiagramBuilder()
        plant_config = MultibodyPlantConfig(
            time_step=time_step, discrete_contact_approximation="lagged"
        )
        self.plant, scene_graph = AddMultibodyPlant(plant_config, builder)
        self.model = AddModel(self.plant, f"package://drake_srg/sdf/{file}.sdf")
        palm = self.plant.GetFrameByName("palm", self.model)
        self.plant.WeldFrames(self.plant.world_frame(), palm)
        self.add_things()
        self.config = config
        config.prepare_plant(self.plant, self.model)
        self.plant.Finalize()
        self.driver = AddGripperDriver(builder, self.plant, self.model, config)
        builder.Connect(
            scene_graph.get_query_output_port(),
            self.driver.GetInputPort("query_object"),
        )
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.root = self.simulator.get_mutable_context()
        self.context = self.driver.GetMyMutableContextFromRoot(self.root)
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.log = {name: [] for name in ("time", *self.logged)}
        self.command(closure_commanded=0.0)

    def add_things(self):
        """Add to the plant what is around the gripper."""

    def command(self, **inputs):
        fix(self.driver, self.context, **inputs)

    def read(self, name):
        return self.driver.GetOutputPort(name).Eval(self.context).copy()

    @property
    def q(self):
        return self.read("state_measured")[: len(self.config.joint_names)]

    def advance(self, duration):
        """Let time pass, and log every `log_period`."""
        for _ in range(round(duration / self.log_period)):
            self.simulator.AdvanceTo(self.root.get_time() + self.log_period)
            self.log["time"].append(self.root.get_time())
            for name in self.logged:
                self.log[name].append(self.read(name))

    def array(self, name):
        return np.array(self.log[name])


# A cylinder across the hand, as far from the palm as in a wrapped grasp.
RADIUS = 0.033
POST = f"""
<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="post">
<link name="post"><collision name="c"><geometry><cylinder><radius>{RADIUS}</radius>
<length>0.2</length></cylinder></geometry><drake:proximity_properties><drake:rigid_hydroelastic/>
<drake:mesh_resolution_hint>0.01</drake:mesh_resolution_hint>
</drake:proximity_properties></collision></link></model></sdf>"""


class SrgHand(DrivenHand):
    """An SRG, with or without a post in the hand."""

    log_period = 0.01
    logged = ("state_measured", "pwm", "proximity")

    def __init__(self, *, post=False, config=None, post_at=0.0791 + RADIUS + 0.006):
        self.post_at = post_at if post else None
        super().__init__("srg", config or SrgPositionDriver(), 0.002)

    def add_things(self):
        if self.post_at is not None:
            Parser(self.plant).AddModelsFromString(POST, "sdf")
            post = self.plant.GetFrameByName("post")
            X_WP = RigidTransform([self.post_at, 0.0, 0.0])
            self.plant.WeldFrames(self.plant.world_frame(), post, X_WP)


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


class LinkageHand(DrivenHand):
    """A linkage gripper, and maybe a cylinder upright in its grasp on a table."""

    log_period = 0.005
    logged = ("state_measured", "proximity", "contact_force", "grasped", "pwm")

    def __init__(
        self,
        *,
        model="linkage_gripper",
        radius=None,
        mass=0.02,
        friction=0.8,
        config=None,
    ):
        self.object = None
        self.cylinder = radius and ObjectConfig(
            shape=Cylinder(radius, LENGTH), mass=mass, friction=friction
        )
        super().__init__(model, config or LinkageDriver(), 0.005)
        table = self.plant.GetModelInstanceByName("table")
        self._table = self.plant.get_desired_state_input_port(table)
        self.lower_table(0.0)
        self.log |= {"loop": [], "object": []}

    def add_things(self):
        Parser(self.plant).AddModelsFromString(TABLE, "sdf")
        actuator = self.plant.GetJointActuatorByName("lift")
        actuator.set_controller_gains(PdControllerGains(p=1e5, d=2e3))
        self.plant.GetJointByName("lift").set_default_translation(-LENGTH / 2 - 0.02)
        if self.cylinder:
            instance = AddObject(self.plant, "cylinder", self.cylinder)
            X_WO = RigidTransform([PALM_TO_TIP, 0.0, 0.0])
            SetDefaultObjectPose(self.plant, instance, X_WO)
            (body,) = self.plant.GetBodyIndices(instance)
            self.object = self.plant.get_body(body)

    def lower_table(self, depth):
        state = [-LENGTH / 2 - 0.02 - depth, 0.0]
        self._table.FixValue(self.plant_context, state)

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
        for _ in range(round(duration / self.log_period)):
            super().advance(self.log_period)
            self.log["loop"].append(self.loop_error())
            if self.object is not None:
                self.log["object"].append(self.p_GO())
