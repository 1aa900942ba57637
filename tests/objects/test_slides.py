"""Slides: how they move, and what they carry."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder

from drake_srg import parsing
from drake_srg.objects.slides import AddSlide, SetSlideGains, SlideConfig, slide_motion

speeds = st.floats(0.005, 0.2)


@given(speeds, st.sampled_from([-1.0, 1.0]), st.floats(0.0, 2.0), st.floats(0.01, 0.4))
def test_a_slide_gets_up_to_speed_and_stops_after_its_travel(speed, sign, start, way):
    config = SlideConfig(speed=sign * speed, start=start, travel=way)
    motion = slide_motion(config, 0.1)
    times = np.linspace(0.0, motion.end_time(), 2000)
    q = motion.vector_values(times)[0]
    v = motion.MakeDerivative().vector_values(times)[0]
    assert q[0] == 0.1
    assert q[-1] == pytest.approx(0.1 + sign * way, abs=1e-9)
    assert np.all(sign * v >= -1e-9)
    assert np.max(np.abs(v)) <= speed * (1 + 1e-6)
    assert np.all(v[times < start] == 0.0)


def test_a_slide_without_speed_stays():
    assert slide_motion(SlideConfig(speed=0.0), 0.2).value(7.0)[0, 0] == 0.2


def make_plant(name="tray", time_step=0.005):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step)
    parsing.AddModel(plant, "package://drake_srg/sdf/tray.sdf", "tray")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("rails"))
    SetSlideGains(plant, name)
    plant.Finalize()
    return builder, plant


def test_the_gains_of_a_turntable_come_from_its_moment_of_inertia():
    """A plate of 2 kg whose center is 0.3 m from the axis."""
    plant = MultibodyPlant(0.005)
    model = plant.AddModelInstance("table")
    cube = UnitInertia.SolidCube(0.1)
    M = SpatialInertia.MakeFromCentralInertia(2.0, [0.3, 0.0, 0.0], 2.0 * cube)
    plate = plant.AddRigidBody("plate", model, M)
    axis = RevoluteJoint("axis", plant.world_frame(), plate.body_frame(), [0, 0, 1])
    plant.AddJointActuator("motor", plant.AddJoint(axis), 100.0)
    SetSlideGains(plant, "table")
    plant.Finalize()
    inertia = plant.CalcMassMatrix(plant.CreateDefaultContext())[0, 0]
    gains = plant.GetJointActuatorByName("motor").get_controller_gains()
    assert gains.p == pytest.approx(inertia * 40.0**2)
    assert gains.d == pytest.approx(2.0 * inertia * 40.0)


@pytest.mark.parametrize("time_step", [0.005, 0.0])
def test_the_tray_keeps_its_speed(time_step):
    builder, plant = make_plant(time_step=time_step)
    AddSlide(builder, plant, "tray", SlideConfig(speed=0.05))
    simulator = Simulator(builder.Build())
    if time_step == 0.0:
        config = SimulatorConfig(integration_scheme="cenic", max_step_size=0.001)
        ApplySimulatorConfig(config, simulator)
    simulator.AdvanceTo(2.0)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    joint = plant.GetJointByName("slide")
    assert joint.get_translation_rate(context) == pytest.approx(0.05, abs=1e-4)
    expected = 0.05 * (2.0 - 0.5 * SlideConfig().ramp)
    assert joint.get_translation(context) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("name", ["rail", "WorldModelInstance"])
def test_what_is_no_slide_is_refused(name):
    with pytest.raises(ValueError, match=rf"slides\.{name}: "):
        make_plant(name)
