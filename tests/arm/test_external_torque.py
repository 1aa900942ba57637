import numpy as np
import pytest
from helpers import fix
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.analysis import Simulator
from pydrake.trajectories import PiecewisePolynomial

from arm.contact_scene import (
    BETWEEN,
    INERTIA,
    MASS,
    PERIOD,
    RADIUS,
    G,
    Scene,
    about_origin,
)
from arm.driven_arm import HOME, DrivenArm
from drake_srg.arm.driver import ArmPositionDriver
from drake_srg.arm.external_torque import (
    TIME_CONSTANT,
    ExternalTorqueObserver,
    lag_share,
)
from drake_srg.objects.poses import ContactReader
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant

CONFIG = ArmPositionDriver(home=list(HOME))


class Arm(DrivenArm):
    """The arm with an observer of its external torques.

    It moves by `turn` (7) [rad] from home within a second.
    """

    def __init__(self, turn=0.0 * HOME, time_step=0.002):
        path = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
            [0.0, 0.5, 1.0],
            np.column_stack([HOME, HOME + 0.5 * turn, HOME + turn]),
            np.zeros((7, 1)),
            np.zeros((7, 1)),
        )
        super().__init__(CONFIG, time_step, path, observed=True)

    def push(self, force, torque=(0.0, 0.0, 0.0)):
        """Push at the palm's origin; return the joints' torques, shape (7,) [N m]."""
        super().push(force, torque)
        world, palm = self.plant.world_frame(), self.plant.GetFrameByName("palm")
        J = self.plant.CalcJacobianSpatialVelocity(
            self.plant_context, JacobianWrtVariable.kV, palm, np.zeros(3), world, world
        )
        return self.plant.GetVelocitiesFromArray(
            self.arm, J.T @ np.concatenate([torque, force])
        )

    @property
    def external(self):
        return self.diagram.GetOutputPort("external_torque").Eval(self.root).copy()

    @property
    def applied(self):
        port = self.plant.get_net_actuation_output_port(self.arm)
        return port.Eval(self.plant_context).copy()


def test_an_arm_at_rest_feels_nothing():
    arm = Arm()
    arm.simulator.AdvanceTo(0.5)
    # Gravity takes 50 N m. The limp fingers swing a little.
    assert np.max(np.abs(arm.external)) < 0.1


@pytest.mark.parametrize(
    ("force", "torque"),
    [([30.0, 0.0, 0.0], [0.0] * 3), ([0.0, -20.0, -15.0], [0.0, 3.0, 2.0])],
)
def test_a_push_is_felt_as_its_torques(force, torque):
    arm = Arm()
    arm.simulator.AdvanceTo(0.3)
    expected = arm.push(force, torque)
    assert np.max(np.abs(expected)) > 5.0
    arm.simulator.AdvanceTo(0.8)
    # The stiff arm gives way by less than 1 mm and 0.1 degrees.
    np.testing.assert_allclose(arm.external, expected, atol=0.3)


def test_the_torques_follow_with_the_lag():
    arm = Arm()
    arm.simulator.AdvanceTo(0.3)
    expected = arm.push([30.0, 0.0, 0.0])
    arm.simulator.AdvanceTo(0.3 + TIME_CONSTANT + CONFIG.period)
    joint = int(np.argmax(np.abs(expected)))
    # 1 - 1/e after the time constant and at most one period more; the stiff arm swings
    # at first.
    share = arm.external[joint] / expected[joint]
    assert 0.5 < share < 0.9
    assert lag_share(TIME_CONSTANT) == pytest.approx(1.0 - np.exp(-1.0))


@pytest.mark.parametrize("time_step", [0.001, 0.004])
def test_free_motion_is_not_taken_for_a_push(time_step):
    turn = np.array([1.0, 0.5, -0.5, 0.7, 0.4, -0.6, 0.8])
    arm = Arm(turn=turn, time_step=time_step)
    most, torque = np.zeros(7), np.zeros(7)
    for time in np.arange(0.02, 1.2, 0.01):
        arm.simulator.AdvanceTo(time)
        most = np.maximum(most, np.abs(arm.external))
        torque = np.maximum(torque, np.abs(arm.applied))
    assert np.max(torque) > 50.0
    # A hundredth of the motors' torque, whatever the number of steps per period.
    assert np.max(most) < 0.5


def test_an_observer_without_a_gripper_has_all_state_in_its_context():
    plant = MakeModelsPlant(load_scenario("assistive_arm"))
    observer = ExternalTorqueObserver(plant, ["arm"], 0.01)
    context, other = observer.CreateDefaultContext(), observer.CreateDefaultContext()
    simulator = Simulator(observer, context)
    fix(observer, context, arm_state=np.zeros(10), torque=np.full(5, 0.3))
    simulator.AdvanceTo(0.2)
    assert np.any(observer.get_output_port().Eval(context))
    np.testing.assert_array_equal(observer.get_output_port().Eval(other), 0.0)


def test_a_continuous_plant_gets_torques_from_contacts_alone():
    arm = Arm(time_step=0.0)
    context = arm.diagram.CreateDefaultContext()
    np.testing.assert_array_equal(
        arm.diagram.GetOutputPort("external_torque").Eval(context), 0.0
    )
    assert not arm.diagram.HasSubsystemNamed("external_torque_observer")


@pytest.fixture(params=["hydroelastic", "point"])
def scene(request):
    return Scene(request.param)


def test_an_untouched_arm_feels_nothing(scene):
    scene.put([2.0, 0.0, 1.0], v=[0.0, 0.0, -1.0])
    for _ in range(2):
        np.testing.assert_array_equal(scene.felt(), 0.0)


def test_a_held_ball_counts_with_its_weight_whatever_its_contacts_say(scene):
    scene.put(BETWEEN, v=[0.0, 0.01, 0.0])
    weight = about_origin([0.0, 0.0, -MASS * G], BETWEEN)
    assert np.max(np.abs(scene.contacts - weight)) > 1.0  # creeping, out of balance
    np.testing.assert_allclose(scene.felt_twice(), weight, rtol=1e-9)


def test_a_ball_that_stands_counts_nothing_when_it_is_touched(scene):
    scene.standing(BETWEEN[0])
    scene.lower(RADIUS)
    assert np.max(np.abs(scene.contacts)) > 1.0
    np.testing.assert_allclose(scene.felt_twice(), 0.0, atol=1e-3)


def test_a_ball_pressed_on_the_table_presses_back(scene):
    height = RADIUS - 0.004
    scene.put([BETWEEN[0], 0.0, height])
    scene.lower(height)
    pressure = scene.pressure()
    assert pressure > 2.0 * MASS * G
    expected = about_origin([0.0, 0.0, pressure - MASS * G], BETWEEN)
    np.testing.assert_allclose(scene.felt_twice(), expected, rtol=1e-3)


def test_fixed_bodies_count_with_their_contacts():
    scene = Scene("point")  # rigid palm and finger meet the table at points only
    scene.put([2.0, 0.0, 1.0])
    scene.plant.SetPositions(scene.context, scene.arm, [-0.971, 0.02])
    assert scene.contacts[0] > 1.0
    np.testing.assert_allclose(scene.felt(), scene.contacts, rtol=1e-9)


def test_a_ball_on_a_link_counts_with_its_contacts(scene):
    scene.put([0.3, 0.0, 1.0 + 0.029 + RADIUS])
    assert abs(scene.contacts[0]) > 0.1
    np.testing.assert_allclose(scene.felt(), scene.contacts, rtol=1e-9)


def test_links_feel_contacts_without_a_hand():
    scene = Scene(gripper=False)
    scene.put([0.3, 0.0, 1.0 + 0.029 + RADIUS])
    np.testing.assert_allclose(scene.felt(), scene.contacts, rtol=1e-9)


def test_a_held_mechanism_counts_with_its_contacts():
    scene = Scene(balls=["bell"])
    scene.put(BETWEEN)
    np.testing.assert_allclose(scene.felt(), scene.contacts, rtol=1e-9)


def test_a_ball_on_the_held_ball_counts():
    scene = Scene(balls=["ball", "ball"])
    scene.put(BETWEEN)
    above = BETWEEN + np.array([0.0, 0.0, 1.98 * RADIUS])
    scene.put(above, name="ball_1")
    results = scene.plant.get_contact_results_output_port().Eval(scene.context)
    force = ContactReader(scene.plant, "ball").forces(results)["ball_1"]
    expected = about_origin([0.0, 0.0, -force - MASS * G], BETWEEN)
    np.testing.assert_allclose(scene.felt_twice(), expected, rtol=1e-3)


_SPEEDS = arrays(float, 3, elements=st.floats(-2.0, 2.0))


@settings(max_examples=20, deadline=None)
@given(dw=_SPEEDS, dv=_SPEEDS)
def test_a_held_ball_resists_acceleration(dw, dv):
    scene = Scene("point")
    scene.put(BETWEEN)
    still = scene.felt_twice()
    scene.put(BETWEEN, w=dw, v=dv)
    inertial = about_origin(-MASS * dv / PERIOD, BETWEEN, -INERTIA * dw / PERIOD)
    np.testing.assert_allclose(scene.felt(), still + inertial, rtol=1e-9, atol=1e-9)


def test_a_ball_that_is_hit_counts_from_its_first_sample_on():
    scene = Scene("point")
    scene.put([2.0, 0.0, 1.0])
    scene.felt()
    scene.put(BETWEEN, v=[0.0, 0.0, 1.0])
    assert scene.felt()[0] == pytest.approx(-MASS / PERIOD)
    assert scene.felt()[0] == pytest.approx(-MASS * G)


def test_forces_on_the_hand_the_ball_and_a_link_count():
    scene = Scene()
    ball = scene.put(BETWEEN)
    palm = scene.plant.GetBodyByName("palm")
    column = scene.plant.GetBodyByName("column")
    still = scene.felt_twice()
    at = np.array([0.0, 0.0, 0.02])
    pulls = {ball: BETWEEN, palm: np.zeros(3), column: np.zeros(3)}
    expected = still.copy()
    forces = []
    for i, (body, p_WB) in enumerate(pulls.items()):
        force, torque = np.array([1.0 + i, 2.0, -3.0]), np.array([0.1, 0.2, 0.3])
        applied = ExternallyAppliedSpatialForce()
        applied.body_index, applied.p_BoBq_B = body.index(), at
        applied.F_Bq_W = SpatialForce(tau=torque, f=force)
        forces.append(applied)
        effect = about_origin(force, p_WB + at, torque)
        expected += effect * ([1.0, 0.0] if body is column else 1.0)  # no hinge
    context = scene.torques.GetMyMutableContextFromRoot(scene.root)
    fix(scene.torques, context, applied_forces=AbstractValue.Make(forces))
    np.testing.assert_allclose(scene.felt_twice(), expected, rtol=1e-9)


def test_a_pressure_of_a_single_sample_is_not_felt(scene):
    scene.standing(BETWEEN[0])
    scene.lower(RADIUS)
    scene.felt_twice()
    low = [BETWEEN[0], 0.0, RADIUS - 0.004]
    scene.put(low)
    assert scene.pressure() > 2.0 * MASS * G
    np.testing.assert_allclose(scene.felt(), 0.0, atol=1e-3)
    scene.standing(BETWEEN[0])
    np.testing.assert_allclose(scene.felt(), 0.0, atol=1e-3)


def test_all_state_is_in_the_context():
    scene = Scene("point")
    scene.put(BETWEEN)
    other = scene.root.Clone()
    scene.felt()
    own = scene.torques.GetMyContextFromRoot(other)
    np.testing.assert_array_equal(scene.torques.get_output_port().Eval(own), 0.0)
