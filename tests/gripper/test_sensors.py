import numpy as np
import pytest
from helpers import fix, read, update
from pydrake.common.value import AbstractValue
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    AddMultibodyPlantSceneGraph,
    ContactResults,
    CoulombFriction,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg import types
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.sensors import (
    SRG_FINGERS,
    ContactForceSensors,
    ProximityConfig,
    ProximitySensors,
    TouchConfig,
)
from drake_srg.objects.config import ObjectConfig, SoftConfig
from drake_srg.objects.models import AddObject, object_body
from drake_srg.parsing import AddModel
from gripper.watching_hand import Hand

RANGE = 0.05  # m


def simulate(builder, plant, scene_graph, sensors):
    builder.Connect(scene_graph.get_query_output_port(), sensors.get_input_port())
    simulator = Simulator(builder.Build())
    root = simulator.get_mutable_context()
    return (
        simulator,
        plant.GetMyMutableContextFromRoot(root),
        sensors.GetMyMutableContextFromRoot(root),
    )


class Line:
    """A ball of 10 mm radius on the x axis that sees a box and another ball all round.

    The face of the box is at x = 0.1 m. The centre of the other ball, with a radius of
    20 mm, is at x = -0.1 m.
    """

    def __init__(self, ignored=(), **config):
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        self.ball = plant.AddRigidBody("ball", SpatialInertia.SolidSphereWithMass(1, 1))

        def add(body, x, shape, name):
            friction = CoulombFriction(1.0, 1.0)
            X = RigidTransform([x, 0.0, 0.0])
            return plant.RegisterCollisionGeometry(body, X, shape, name, friction)

        own = add(self.ball, 0.0, Sphere(0.01), "own")
        others = {
            "box": add(plant.world_body(), 0.15, Box(0.1, 0.1, 0.1), "box"),
            "sphere": add(plant.world_body(), -0.1, Sphere(0.02), "sphere"),
        }
        plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        plant.Finalize()
        self.sensors = builder.AddSystem(
            ProximitySensors(
                {"only": [own]},
                {"only": [others[name] for name in ignored]},
                ProximityConfig(**{"range": RANGE, "half_angle": np.pi, **config}),
            )
        )
        self.plant = plant
        self.simulator, self.plant_context, self.context = simulate(
            builder, plant, scene_graph, self.sensors
        )

    def put(self, x):
        self.plant.SetFreeBodyPose(
            self.plant_context, self.ball, RigidTransform([x, 0.0, 0.0])
        )

    def reading(self, x):
        """Return distance and trigger with the ball at x."""
        self.put(x)
        update(self.sensors, self.context)
        return tuple(read(self.sensors, self.context, name)[0] for name in PORTS)


PORTS = ("proximity", "triggered")


@pytest.mark.parametrize(
    ("x", "distance"),
    [
        (0.07, 0.02),  # 30 mm to the face, less the radius
        (0.088, 0.002),
        (0.095, -0.005),  # penetration
        (-0.04, 0.03),  # 60 mm to the ball's centre, less both radii
        (0.0, RANGE),  # nothing within the range
    ],
)
def test_distances_are_signed_and_saturate(x, distance):
    reading, triggered = Line().reading(x)
    assert reading == pytest.approx(distance, abs=1e-6)
    assert triggered == (distance < 0.003)


def test_the_nearest_geometry_counts():
    assert Line(range=0.2).reading(0.02)[0] == pytest.approx(0.07, abs=1e-6)
    assert Line(range=0.2).reading(-0.02)[0] == pytest.approx(0.05, abs=1e-6)


def test_the_trigger_distance_can_be_chosen():
    assert Line(trigger_distance=0.01).reading(0.081)[1] == 1.0
    assert Line(trigger_distance=0.008).reading(0.081)[1] == 0.0


def test_a_sensor_does_not_see_what_it_ignores():
    assert Line(ignored=["box"]).reading(0.095)[0] == RANGE
    assert Line(ignored=["sphere"]).reading(0.095)[0] < 0.0


def test_a_reading_is_taken_once_per_period():
    line = Line(period=0.02)
    line.put(0.07)
    line.simulator.AdvanceTo(0.01)
    first = read(line.sensors, line.context, "proximity")[0]
    assert first == pytest.approx(0.02, abs=1e-6)
    line.put(0.08)
    line.simulator.AdvanceTo(0.019)
    assert read(line.sensors, line.context, "proximity")[0] == first
    line.simulator.AdvanceTo(0.021)
    reading = read(line.sensors, line.context, "proximity")[0]
    assert reading == pytest.approx(0.01, abs=1e-6)


# The SRG.


def srg_readings(q, post=(0.0, 0.0, 1.0), **config):
    """Return the four distances with the joints at q, and a ball at a point."""
    srg = Hand("srg", SRG_FINGERS, **{"range": RANGE, **config})
    for name, angle in zip(SRG_FINGERS.joint_names, q, strict=True):
        srg.plant.GetJointByName(name).set_angle(srg.plant_context, angle)
    return srg.readings(post)


def test_an_open_hand_sees_neither_itself_nor_its_palm():
    np.testing.assert_array_equal(srg_readings([0.0] * 4), [RANGE] * 4)


def test_a_hand_with_bent_tips_does_not_see_itself():
    # The fingers are spread wide, the tips bent by 70 degrees.
    assert np.all(srg_readings([0.0, 0.0, 1.2, 1.2], range=0.02) == 0.02)


def test_the_tips_see_the_other_finger():
    # With both fingers straight ahead, the hinges are 60 mm apart and the faces 9.2 mm
    # inward of them.
    readings = srg_readings([np.pi / 2, np.pi / 2, 0.0, 0.0])
    np.testing.assert_array_equal(readings[:2], RANGE)
    assert readings[2:] == pytest.approx([0.0416, 0.0416], abs=1e-3)


@pytest.mark.parametrize(
    ("post", "nearest"),
    [
        # Open fingers point sideways from the hinges at x = 73 mm, y = ±30 mm. A base
        # link is 52 mm long.
        ([0.10, 0.055, 0.0], 0),
        ([0.10, -0.055, 0.0], 1),
        ([0.10, 0.115, 0.0], 2),
        ([0.10, -0.115, 0.0], 3),
    ],
)
def test_each_sensor_measures_from_its_own_link(post, nearest):
    readings = srg_readings([0.0] * 4, post)
    assert np.argmin(readings) == nearest
    assert readings[nearest] < 0.03


MASS, G = 0.1, 9.81
BALL = f"""
<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="ball">
<link name="ball"><inertial><mass>{MASS}</mass><inertia><ixx>1e-5</ixx><iyy>1e-5</iyy>
<izz>1e-5</izz></inertia></inertial><collision name="c"><geometry><sphere>
<radius>0.01</radius></sphere></geometry><drake:proximity_properties>
<drake:rigid_hydroelastic/><drake:mesh_resolution_hint>0.002</drake:mesh_resolution_hint>
</drake:proximity_properties></collision></link></model></sdf>"""
CUBE = ObjectConfig(
    shape=types.Box([0.02, 0.02, 0.02]),
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
    sensors = TouchConfig().AddSensor(builder, plant, model, SRG_FINGERS)
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
