import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.geometry import Box as BoxGeometry
from pydrake.geometry import GeometryInstance, ProximityProperties, SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig, SleepingConfig
from drake_srg.scenario import load_scenario
from drake_srg.simulation.rig import Rig, tabletop
from drake_srg.station import MakeStation
from drake_srg.station.sleeping import MakeAdvance, SleepMonitor, box_gaps
from drake_srg.types import Box

angles = st.floats(-np.pi, np.pi)
sizes = st.lists(st.floats(0.01, 0.2), min_size=3, max_size=3)
places = st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3)
boxes = st.tuples(places, st.lists(angles, min_size=3, max_size=3), sizes)


def distance(first, second):
    """Return Drake's distance of two boxes (p, rpy, halves); 0 if they overlap."""
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("boxes")
    ids = []
    for i, (p, rpy, halves) in enumerate((first, second)):
        X = RigidTransform(RollPitchYaw(*rpy), p)
        box = GeometryInstance(X, BoxGeometry(*(2 * np.array(halves))), f"box {i}")
        box.set_proximity_properties(ProximityProperties())
        ids.append(scene_graph.RegisterAnchoredGeometry(source, box))
    context = scene_graph.CreateDefaultContext()
    query = scene_graph.get_query_output_port().Eval(context)
    pair = query.ComputeSignedDistancePairClosestPoints(*ids)
    return max(pair.distance, 0.0)


@given(boxes, boxes)
def test_a_gap_is_never_longer_than_the_distance(first, second):
    p, rpy, halves = (np.array(x) for x in zip(first, second, strict=True))
    R = np.array([RollPitchYaw(*a).ToRotationMatrix().matrix() for a in rpy])
    gaps = box_gaps(p, R, halves, 2)
    assert gaps[0, 1] == pytest.approx(gaps[1, 0], abs=1e-12)
    assert gaps[0, 1] <= distance(first, second) + 1e-6
    assert gaps[0, 0] == gaps[1, 1] == np.inf


def test_the_gap_between_parallel_faces_is_their_distance():
    p = np.array([[0.0, 0.0, 0.0], [0.3, 0.05, 0.0]])
    gaps = box_gaps(p, np.array([np.eye(3)] * 2), np.full((2, 3), 0.1), 1)
    assert gaps.shape == (1, 2)
    assert gaps[0, 1] == pytest.approx(0.1)


def test_an_object_that_nothing_can_touch_is_a_point():
    plant, scene_graph = MultibodyPlant(0.01), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    ghost = plant.AddRigidBody("ghost", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    plant.Finalize()
    objects = {"ghost": ghost.index()}
    config = SleepingConfig()
    monitor = SleepMonitor(plant, scene_graph.model_inspector(), objects, config)
    context = monitor.CreateDefaultContext()
    context.SetTime(2 * config.after)
    still = plant.get_body_spatial_velocities_output_port()
    poses = plant.get_body_poses_output_port()
    of_plant = plant.CreateDefaultContext()
    for name, port in (("body_poses", poses), ("body_spatial_velocities", still)):
        monitor.GetInputPort(name).FixValue(context, port.Eval(of_plant))
    assert monitor.GetOutputPort("objects_asleep").Eval(context) == {"ghost"}


QUICKLY = SleepingConfig(after=0.1, speed=5e-3)


def block(x, z=None, **changes):
    """A block of 5 cm on the table at (x, 0), or with its middle at z."""
    values = {"shape": Box([0.05] * 3), "mass": 0.2, "friction": 0.5, **changes}
    thing = ObjectConfig(position=[x, 0.0], **values)
    if z is not None:
        pose = (
            load_scenario(
                "gripper_bench",
                overrides=[
                    "objects.soup_can.position=null",
                    f"objects.soup_can.pose={{translation: [{x}, 0.0, {z}]}}",
                ],
            )
            .objects["soup_can"]
            .pose
        )
        thing.position, thing.pose = None, pose
    return thing


def make(sleeping=QUICKLY, **objects):
    return Rig(tabletop(objects, sleeping), period=0.01, log_period=0.01)


def asleep(rig):
    port = rig.station.GetOutputPort("objects_asleep_cheat")
    names = port.Eval(rig.station.GetMyContextFromRoot(rig.context))
    for name in rig.scenario.objects:
        body = rig.plant.GetBodyByName("object", model(rig, name))
        assert body.is_locked(rig.plant_context) == (name in names)
    return set(names)


def model(rig, name):
    return rig.plant.GetModelInstanceByName(name)


def push(rig, name, force):
    applied = ExternallyAppliedSpatialForce()
    applied.body_index = rig.plant.GetBodyByName("object", model(rig, name)).index()
    applied.F_Bq_W = SpatialForce(tau=np.zeros(3), f=force)
    value = AbstractValue.Make([applied])
    if not any(force):
        value.set_value([])  # a force of zero would keep it awake
    rig.diagram.GetInputPort("object_forces_cheat").FixValue(rig.context, value)


def test_objects_at_rest_sleep_and_stay_where_they_are():
    rig = make(near=block(0.3), far=block(0.6))
    assert asleep(rig) == set()
    rig.advance(0.4)
    assert asleep(rig) == {"near", "far"}
    before = rig.X_WO("near")
    rig.advance(0.2)
    assert rig.X_WO("near").IsExactlyEqualTo(before)
    assert asleep(rig) == {"near", "far"}


def test_objects_stay_awake_without_the_key():
    rig = make(sleeping=None, near=block(0.3))
    rig.advance(0.4)
    assert not rig.station.HasOutputPort("objects_asleep_cheat")
    assert not rig.plant.GetBodyByName("object").is_locked(rig.plant_context)


def test_a_falling_object_wakes_what_it_falls_on_before_it_arrives():
    rig = make(below=block(0.3), falling=block(0.3, z=0.6), beside=block(0.6))
    slept, woken_at, touched_at = False, None, None
    for _ in range(60):
        rig.advance(0.01)
        names = asleep(rig)
        slept |= "below" in names
        gap = rig.X_WO("falling").translation()[2] - 0.075
        if slept and woken_at is None and "below" not in names:
            woken_at, gap_then = rig.time, gap
        if touched_at is None and "falling" in rig.contact_forces("below"):
            touched_at = rig.time
        assert rig.time < 0.4 or "beside" in names
    assert slept
    assert woken_at < touched_at
    assert 0.0 < gap_then < 0.06


def test_a_push_wakes_at_once_and_those_that_it_drives_into_others():
    rig = make(pushed=block(0.3), hit=block(0.39), behind=block(0.7))
    rig.advance(0.4)
    start = rig.X_WO("pushed").translation()[0]
    push(rig, "pushed", [4.0, 0.0, 0.0])
    rig.advance(0.01)
    assert asleep(rig) == {"hit", "behind"}
    rig.advance(0.09)
    assert "hit" not in asleep(rig)
    push(rig, "pushed", [0.0, 0.0, 0.0])
    rig.advance(0.2)
    # It has crossed the gap of 40 mm, and the other gave way.
    assert rig.X_WO("pushed").translation()[0] > start + 0.04
    assert rig.X_WO("hit").translation()[0] > 0.395
    assert "behind" in asleep(rig)


@pytest.mark.parametrize("gap", [0.001, 0.02])
def test_neighbours_that_touch_wake_together(gap):
    rig = make(first=block(0.3), second=block(0.35 + gap))
    rig.advance(0.4)
    push(rig, "first", [-0.1, 0.0, 0.0])  # friction holds it
    rig.advance(0.01)
    assert asleep(rig) == ({"second"} if gap > 0.005 else set())


def test_neighbours_that_come_to_rest_one_after_the_other_sleep():
    rig = make(first=block(0.3), second=block(0.352, z=0.035))  # falls by 10 mm
    rig.advance(0.1)
    assert asleep(rig) == set()
    rig.advance(0.4)
    assert asleep(rig) == {"first", "second"}


def test_an_object_falls_asleep_some_time_after_a_push():
    rig = make(pushed=block(0.3))
    rig.advance(0.4)
    push(rig, "pushed", [-0.1, 0.0, 0.0])  # friction holds it
    rig.advance(0.2)
    assert asleep(rig) == set()
    push(rig, "pushed", [0.0, 0.0, 0.0])
    rig.advance(0.08)
    assert asleep(rig) == set()
    rig.advance(0.05)
    assert asleep(rig) == {"pushed"}


def test_a_pushed_object_ends_where_it_ends_awake():
    ends = []
    for sleeping, step in (
        (None, 0.005),
        (None, 0.0025),
        (SleepingConfig(), 0.005),
        (SleepingConfig(), 0.005),
    ):
        scenario = tabletop({"pushed": block(0.3), "hit": block(0.38)}, sleeping)
        scenario.plant_config.time_step = step
        rig = Rig(scenario, period=0.01, log_period=0.01)
        rig.advance(1.0)
        push(rig, "pushed", [3.0, 0.2, 0.0])
        rig.advance(0.1)
        push(rig, "pushed", [0.0, 0.0, 0.0])
        rig.advance(0.4)
        ends.append([rig.X_WO(name).translation() for name in ("pushed", "hit")])
    awake, half, once, again = map(np.array, ends)
    assert awake[1, 0] > 0.382  # it was hit
    np.testing.assert_array_equal(once, again)
    assert np.abs(once - awake).max() < max(np.abs(half - awake).max(), 1e-4)


def test_the_steps_of_the_caller_do_not_matter():
    ends = []
    for steps in (1, 7, 50):
        scenario = tabletop({"falling": block(0.3, z=0.1)}, QUICKLY)
        station = MakeStation(scenario)
        simulator = Simulator(station)
        advance = MakeAdvance(simulator, station, scenario)
        for k in range(1, steps + 1):
            advance(0.35 * k / steps)
        plant = station.GetSubsystemByName("plant")
        context = plant.GetMyContextFromRoot(simulator.get_context())
        assert plant.GetBodyByName("object").is_locked(context)
        ends.append(plant.GetPositions(context))
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, atol=1e-9)


def test_a_diagram_without_a_monitor_is_refused():
    scenario = tabletop({}, QUICKLY)
    builder = DiagramBuilder()
    builder.AddSystem(MakeStation(scenario)).set_name("my_station")
    diagram = builder.Build()
    with pytest.raises(ScenarioError, match=r"^sleeping: needs a subsystem `station`"):
        MakeAdvance(Simulator(diagram), diagram, scenario)


def test_another_call_takes_over_the_sleepers():
    rig = make(near=block(0.3))
    rig.advance(0.4)
    assert asleep(rig) == {"near"}
    advance = MakeAdvance(rig.simulator, rig.station, rig.scenario)
    height = rig.X_WO("near").translation()[2]
    push(rig, "near", [0.1, 0.0, 0.0])
    advance(0.6)
    assert asleep(rig) == set()
    # It rests on its table again, which a forgotten filter would let it fall through.
    assert rig.X_WO("near").translation()[2] == pytest.approx(height, abs=1e-3)
