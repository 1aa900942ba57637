"""An arm, a hand, a table and balls in a continuous plant."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.systems.framework import DiagramBuilder

from drake_srg.arm.external_torque import AddExternalTorque, lag_share
from drake_srg.objects.poses import ContactReader

PERIOD, G = 0.01, 9.81
MASS, RADIUS, INERTIA = 0.3, 0.05, 3e-4  # of the balls
REACH = 0.5  # of the hand, along x [m]
_CONTACT = """<drake:proximity_properties>{}<drake:mu_dynamic>0.8</drake:mu_dynamic>
<drake:mesh_resolution_hint>0.01</drake:mesh_resolution_hint>
</drake:proximity_properties>"""
RIGID = _CONTACT.format("<drake:rigid_hydroelastic/>")
SOFT = _CONTACT.format(
    "<drake:compliant_hydroelastic/>"
    "<drake:hydroelastic_modulus>1e6</drake:hydroelastic_modulus>"
)


def box(name, size, xyz):
    return f"""<collision name="{name}"><pose>{xyz} 0 0 0</pose><geometry><box>
    <size>{size}</size></box></geometry>{RIGID}</collision>"""


def model(name, content):
    return f"""<sdf version="1.9" xmlns:drake="http://drake.mit.edu">
    <model name="{name}">{content}</model></sdf>"""


# A slide along z, whose torque is a force, and a hinge about y, both at the origin. The
# hand's palm is at x = REACH, its middle at height 1, and 96 mm from the finger.
ARM = model(
    "arm",
    f"""<link name="column">{box("c", "0.1 0.1 0.06", "0 0 1")}</link>
    <link name="beam">{box("c", "0.1 0.1 0.06", "0.3 0 1")}</link>
    <joint name="slide" type="prismatic"><parent>world</parent><child>column</child>
    <axis><xyz>0 0 1</xyz></axis></joint>
    <joint name="hinge" type="revolute"><parent>column</parent><child>beam</child>
    <axis><xyz>0 1 0</xyz></axis></joint>""",
)
GRIPPER = model(
    "gripper",
    f"""<link name="palm">{box("c", "0.02 0.1 0.06", f"{REACH} 0 1")}</link>
    <link name="finger">{box("c", "0.02 0.1 0.06", f"{REACH + 0.116} 0 1")}</link>
    <joint name="grip" type="prismatic"><parent>palm</parent><child>finger</child>
    <axis><xyz>1 0 0</xyz></axis></joint>""",
)
# A ball there is 1 mm deep in the palm and 3 mm deep in the finger.
BETWEEN = np.array([REACH + 0.059, 0.0, 1.0])
TABLE = model(
    "table",
    f"<static>true</static><link name='top'>{box('c', '4 4 0.1', '0 0 -0.05')}</link>",
)
BALL = model(
    "ball",
    f"""<link name="ball"><inertial><mass>{MASS}</mass><inertia><ixx>{INERTIA}</ixx>
    <iyy>{INERTIA}</iyy><izz>{INERTIA}</izz></inertia></inertial><collision name="c">
    <geometry><sphere><radius>{RADIUS}</radius></sphere></geometry>{SOFT}</collision>
    </link>""",
)
# A ball that is not a single body, because a bob hangs in it.
BELL = BALL.replace(
    "</model>",
    """<link name="bob"/><joint name="pivot" type="revolute"><parent>ball</parent>
    <child>bob</child><axis><xyz>1 0 0</xyz></axis></joint></model>""",
)


def add_models(plant, gripper=True):
    parser = Parser(plant)
    (arm,) = parser.AddModelsFromString(ARM, "sdf")
    if not gripper:
        return arm, None
    (hand,) = parser.AddModelsFromString(GRIPPER, "sdf")
    plant.WeldFrames(plant.GetFrameByName("beam"), plant.GetFrameByName("palm"))
    return arm, hand


class Scene:
    """An arm, with or without a hand, above a table, and balls."""

    def __init__(self, contact="hydroelastic", balls=("ball",), gripper=True):
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(time_step=0.0, contact_model=contact)
        self.plant, _ = AddMultibodyPlant(config, builder)
        self.arm, hand = add_models(self.plant, gripper)
        parser = Parser(self.plant)
        parser.SetAutoRenaming(True)
        parser.AddModelsFromString(TABLE, "sdf")
        for ball in balls:
            parser.AddModelsFromString({"ball": BALL, "bell": BELL}[ball], "sdf")
        self.plant.Finalize()
        models = MultibodyPlant(time_step=0.0)
        add_models(models, gripper)
        models.Finalize()
        AddExternalTorque(builder, self.plant, self.arm, hand, models, PERIOD)
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.torques = self.diagram.GetSubsystemByName("contact_torques")
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)

    def put(self, p_WB, w=(0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0), name="ball"):
        """Put a ball in a place [m], with velocities [rad/s, m/s]."""
        ball = self.plant.GetBodyByName("ball", self.plant.GetModelInstanceByName(name))
        self.plant.SetFreeBodyPose(self.context, ball, RigidTransform(p_WB))
        velocity = SpatialVelocity(w=w, v=v)
        self.plant.SetFreeBodySpatialVelocity(self.context, ball, velocity)
        return ball

    def felt(self):
        """Return the torques of the next sample with the lag undone [N, N m]."""
        context = self.torques.GetMyMutableContextFromRoot(self.root)
        port, share = self.torques.get_output_port(), lag_share(PERIOD)
        before = port.Eval(context).copy()
        updated = self.torques.EvalUniquePeriodicDiscreteUpdate(context)
        context.SetDiscreteState(updated)
        return before + (port.Eval(context) - before) / share

    def felt_twice(self):
        """Return the same for a scene that lasts for two samples."""
        self.felt()
        return self.felt()

    @property
    def contacts(self):
        """The plant's own contact torques [N, N m]."""
        port = self.plant.get_generalized_contact_forces_output_port(self.arm)
        return port.Eval(self.context).copy()

    def standing(self, x):
        """Put a ball on the table at (x, 0), at the height where it is in balance."""
        high, low = RADIUS, RADIUS - 0.01
        for _ in range(40):
            self.put([x, 0.0, 0.5 * (low + high)])
            if self.pressure() > MASS * G:
                low = 0.5 * (low + high)
            else:
                high = 0.5 * (low + high)

    def pressure(self):
        """Return the force between ball and table [N]."""
        results = self.plant.get_contact_results_output_port().Eval(self.context)
        return ContactReader(self.plant, "ball").forces(results).get("support", 0.0)

    def lower(self, z):
        """Lower the arm so that its hand is at a height [m]."""
        self.plant.GetJointByName("slide").set_translation(self.context, z - 1.0)


def about_origin(force, p, torque=(0.0, 0.0, 0.0)):
    """Return what slide and hinge feel of a force [N] at a point [m] and a torque."""
    return np.array([force[2], (np.cross(p, force) + torque)[1]])
