import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import Box, GeometryInstance, ProximityProperties, SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

from drake_srg.objects.config import SleepingConfig
from drake_srg.objects.sleeping import SleepMonitor, box_gaps

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
        box = GeometryInstance(X, Box(*(2 * np.array(halves))), f"box {i}")
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
