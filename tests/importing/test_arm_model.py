import numpy as np
from objects.meshes.made_meshes import elbow, write_obj
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg import parsing
from drake_srg.common.systems import model_actuators
from drake_srg.importing.arm_file import read_arm
from drake_srg.importing.arm_model import EFFORT_PER_INERTIA, write_model
from importing.made_arms import joint, link, two_axes


def written(tmp_path, text):
    """Return the plant and scene graph of an arm's model, and its ignored pairs."""
    file, model = tmp_path / "arm.urdf", tmp_path / "model.sdf"
    file.write_text(text)
    ignored = write_model(read_arm(file), model)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    arm = parsing.AddModel(plant, model, "arm")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("link_0", arm))
    plant.Finalize()
    return plant, scene_graph, ignored


def test_the_model_has_the_files_limits_and_motors(tmp_path):
    plant, _, _ = written(tmp_path, two_axes())
    arm = plant.GetModelInstanceByName("arm")
    pan, lift = model_actuators(plant, arm)
    assert (pan.effort_limit(), pan.joint().name()) == (200.0, "pan")
    assert pan.default_rotor_inertia() == 200.0 / EFFORT_PER_INERTIA
    assert lift.joint().position_upper_limits()[0] == 3.1
    np.testing.assert_allclose(plant.GetAccelerationUpperLimits(), 10.0)
    context = plant.CreateDefaultContext()
    assert np.isclose(plant.CalcTotalMass(context), 13.0)
    flange = plant.GetFrameByName("flange", arm).CalcPoseInWorld(context)
    # Without a frame for tools, it is on the last link's outer face, along the axis.
    np.testing.assert_allclose(flange.rotation().col(2), [0, 1, 0], atol=1e-9)


def test_collision_meshes_become_hulls(tmp_path):
    write_obj(tmp_path / "elbow.obj", elbow())
    mesh = """<link name="a/b"><collision><geometry>
      <mesh filename="elbow.obj"/></geometry></collision></link>"""
    mesh += joint("roll", "0 0 0.5", "0 0 0", "0 0 1", 2, 20, "link2", "a/b")
    plant, scene_graph, _ = written(tmp_path, two_axes(mesh))
    body = plant.GetBodyByName("a/b")
    (geometry,) = plant.GetCollisionGeometriesForBody(body)
    hull = scene_graph.model_inspector().GetConvexHull(geometry)
    assert hull.num_vertices() >= 8
    assert (tmp_path / "a_b_0.obj").is_file()


def test_pairs_that_always_or_never_touch_are_ignored(tmp_path):
    """One link is within another one's neighbour, and one is out of reach."""
    inside = link("inside", "0 0 0.1", "0 0 0", 0.02, 0.05, 0.1)
    inside += joint("in", "0 0 0", "0 0 0", "0 0 1", 1, 1, "link2", "inner")
    inside += link("inner", "0 0 0.03", "0 0 0", 0.005, 0.01, 0.1)
    inside += joint("on", "0 0 0", "0 0 0", "0 0 1", 1, 1, "inner", "inside")
    _, _, ignored = written(tmp_path, two_axes(inside))
    assert "link2 and inside" in ignored  # always
    assert "link0 and inner" in ignored  # never
    assert "link0 and link1" not in ignored  # neighbours
