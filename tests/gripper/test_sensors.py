import numpy as np
import pytest
from helpers import read, update
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.gripper.sensors import SRG_FINGERS, ProximityConfig, ProximitySensors
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
