"""An SRG with a driver, and a post to hold."""

from helpers import fix
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.gripper import SrgPositionDriver
from drake_srg.gripper.drivers import AddGripperDriver
from drake_srg.parsing import AddModel

# A cylinder across the hand, as far from the palm as in a wrapped grasp.
RADIUS = 0.033
CYLINDER = f"""
<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="post">
<link name="post"><collision name="c"><geometry><cylinder><radius>{RADIUS}</radius>
<length>0.2</length></cylinder></geometry><drake:proximity_properties><drake:rigid_hydroelastic/>
<drake:mesh_resolution_hint>0.01</drake:mesh_resolution_hint>
</drake:proximity_properties></collision></link></model></sdf>"""


class Hand:
    """An SRG with its palm fixed and level, with or without a post in the hand."""

    def __init__(self, *, post=False, config=None, post_at=0.0791 + RADIUS + 0.006):
        builder = DiagramBuilder()
        plant_config = MultibodyPlantConfig(
            time_step=0.002, discrete_contact_approximation="lagged"
        )
        self.plant, scene_graph = AddMultibodyPlant(plant_config, builder)
        parser = Parser(self.plant)
        self.model = AddModel(self.plant, "package://drake_srg/sdf/srg.sdf")
        world, palm = self.plant.world_frame(), self.plant.GetFrameByName("palm")
        self.plant.WeldFrames(world, palm)
        if post:
            parser.AddModelsFromString(CYLINDER, "sdf")
            X_WP = RigidTransform([post_at, 0.0, 0.0])
            self.plant.WeldFrames(world, self.plant.GetFrameByName("post"), X_WP)
        config = config or SrgPositionDriver()
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
        self.log = {"time": [], "q": [], "pwm": [], "proximity": []}
        self.command(closure_commanded=0.0)

    def command(self, **inputs):
        fix(self.driver, self.context, **inputs)

    def read(self, name):
        return self.driver.GetOutputPort(name).Eval(self.context).copy()

    @property
    def q(self):
        return self.read("state_measured")[:4]

    def advance(self, duration):
        """Let time pass, and log every 10 ms."""
        for _ in range(round(duration / 0.01)):
            self.simulator.AdvanceTo(self.root.get_time() + 0.01)
            self.log["time"].append(self.root.get_time())
            self.log["q"].append(self.q)
            for name in ("pwm", "proximity"):
                self.log[name].append(self.read(name))
