import numpy as np
import pytest
from helpers import fix, read
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ContactResults,
    MultibodyPlantConfig,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.sensors import (
    SRG_FINGERS,
    AddContactForceSensors,
    ContactForceSensors,
    TouchConfig,
)
from drake_srg.objects.config import ObjectConfig, SoftConfig
from drake_srg.objects.models import AddObject, object_body
from drake_srg.parsing import AddModel
from drake_srg.types import Box

MASS, G = 0.1, 9.81
BALL = f"""
<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="ball">
<link name="ball"><inertial><mass>{MASS}</mass><inertia><ixx>1e-5</ixx><iyy>1e-5</iyy>
<izz>1e-5</izz></inertia></inertial><collision name="c"><geometry><sphere>
<radius>0.01</radius></sphere></geometry><drake:proximity_properties>
<drake:rigid_hydroelastic/><drake:mesh_resolution_hint>0.002</drake:mesh_resolution_hint>
</drake:proximity_properties></collision></link></model></sdf>"""
CUBE = ObjectConfig(
    shape=Box([0.02, 0.02, 0.02]),
    soft=SoftConfig(youngs_modulus=1.0e5),
    mass=MASS,
    friction=1.0,
    resolution=0.01,
)
# Where the ball rests on the tip's pad: the middle of its face in the tip's frame [m].
PAD = np.array([SRG.pad_middle, SRG.face_offset, 0.0])


def rest_on_a_pad(thing, side):
    """Return the sensors of a tip whose pad faces up, with a ball or a cube at rest."""
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(
        time_step=0.002,
        contact_model="point" if thing == "point" else "hydroelastic_with_fallback",
        discrete_contact_approximation="sap",
    )
    plant, _ = AddMultibodyPlant(config, builder)
    parser = Parser(plant)
    model = AddModel(plant, "package://drake_srg/sdf/srg.sdf")
    if thing == "soft":
        cube = AddObject(plant, "cube", CUBE)
    else:
        parser.AddModelsFromString(BALL, "sdf")
    # The y of an open finger, its closing side, is the palm's x, which points up here.
    X_WP = RigidTransform(RollPitchYaw(0.0, -np.pi / 2, 0.0), [0.0, 0.0, 0.0])
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm"), X_WP)
    for name in ("left_base", "right_base", "left_tip", "right_tip"):
        plant.GetJointByName(f"{name}_joint").set_position_limits([0.0], [0.0])
    plant.Finalize()
    sensors = AddContactForceSensors(builder, plant, model, SRG_FINGERS)
    for source, name in (
        (plant.get_contact_results_output_port(), "contact_results"),
        (plant.get_body_poses_output_port(), "body_poses"),
    ):
        builder.Connect(source, sensors.GetInputPort(name))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for name in ("left_base", "right_base", "left_tip", "right_tip"):
        plant.GetJointByName(f"{name}_joint").Lock(context)
    tip = plant.GetBodyByName(f"{side}_tip_link")
    X_WT = plant.EvalBodyPoseInWorld(context, tip)
    above = RigidTransform(X_WT.rotation(), X_WT @ (PAD + np.array([0.0, 0.0101, 0.0])))
    if thing == "soft":
        body = object_body(plant, cube)
        body.SetPositions(context, above @ body.GetPositions(context))
    else:
        plant.SetFreeBodyPose(context, plant.GetBodyByName("ball"), above)
    simulator.AdvanceTo(0.5)
    return sensors, sensors.GetMyContextFromRoot(simulator.get_context())


CASES = [("hydroelastic", "left"), ("hydroelastic", "right")]
CASES += [("point", "left"), ("soft", "left")]


@pytest.fixture(scope="module", params=CASES, ids="-".join)
def resting(request):
    return rest_on_a_pad(*request.param)


@pytest.fixture
def tip(request):
    """The index of the tip among left base, right base, left tip, right tip."""
    return 3 if "right" in request.node.callspec.id else 2


def test_the_pad_feels_the_weight(resting, tip):
    expected = np.zeros(4)
    expected[tip] = MASS * G
    assert read(*resting, "contact_force") == pytest.approx(expected, rel=1e-3, abs=0)


def test_the_wrench_is_that_of_the_weight(resting, tip):
    wrench = read(*resting, "contact_wrench").reshape(4, 6)
    force = np.array([0.0, -MASS * G, 0.0])
    assert wrench[tip, 3:] == pytest.approx(force, abs=1e-3)
    # The weight's moment about the tip's hinge.
    assert wrench[tip, :3] == pytest.approx(np.cross(PAD, force), abs=1e-4)
    assert not np.delete(wrench, tip, axis=0).any()


def test_a_touch_fires(resting, tip):
    assert list(np.flatnonzero(read(*resting, "triggered"))) == [tip]


def make(config=None):
    sensors = ContactForceSensors({"pad": (0, [])}, config)
    context = sensors.CreateDefaultContext()
    fix(
        sensors,
        context,
        contact_results=AbstractValue.Make(ContactResults()),
        body_poses=AbstractValue.Make([RigidTransform()]),
    )
    return sensors, context


def test_without_contact_there_is_no_force():
    sensors, context = make(TouchConfig(trigger_force=1e-9))
    for name in ("contact_force", "contact_wrench", "triggered"):
        assert not read(sensors, context, name).any()
