"""Every format holds the same masses, inertias, joints and limits."""

import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from .exported import SCENARIOS, exported, parsed

CASES = [("kitchen_tendon", "gripper"), *((name, "scene") for name in SCENARIOS)]


def links(model):
    return [link for link in model.links if link.mass > 0.0]


@pytest.mark.parametrize("kind", ["urdf", "sdf"])
@pytest.mark.parametrize(("name", "part"), CASES)
def test_drake_reads_the_same_links_and_joints(name, part, kind):
    file = exported(name, kind)[part]
    plant = parsed(file.path)
    for link in links(file.model):
        inertia = plant.GetBodyByName(link.name).default_spatial_inertia()
        central = inertia.Shift(link.p_LC).CalcRotationalInertia().CopyToFullMatrix3()
        np.testing.assert_allclose(inertia.get_mass(), link.mass, rtol=1e-10)
        np.testing.assert_allclose(inertia.get_com(), link.p_LC, atol=1e-12)
        np.testing.assert_allclose(central, link.I_C, rtol=1e-6, atol=1e-14)
    for joint in file.model.joints:
        if joint.kind == "fixed":
            continue
        found = plant.GetJointByName(joint.name)
        assert found.type_name() == joint.kind
        assert found.position_lower_limit() == pytest.approx(joint.lower)
        assert found.position_upper_limit() == pytest.approx(joint.upper)
        assert found.velocity_upper_limit() == pytest.approx(joint.velocity)
        assert found.acceleration_upper_limit() == pytest.approx(joint.acceleration)
        assert found.default_damping() == pytest.approx(joint.damping)
        driven = plant.HasJointActuatorNamed(joint.name)
        assert driven == (joint.effort > 0.0)
        if driven:
            actuator = plant.GetJointActuatorByName(joint.name)
            assert actuator.effort_limit() == pytest.approx(joint.effort)
            assert actuator.default_reflected_inertia() == pytest.approx(joint.armature)
            assert actuator.has_controller() == (joint.gains is not None)
    mimics = [joint for joint in file.model.joints if joint.mimic]
    assert plant.num_constraints() == len(mimics) + len(file.model.loops)


@pytest.mark.parametrize("kind", ["urdf", "sdf"])
@pytest.mark.parametrize("name", SCENARIOS)
def test_drake_places_the_links_of_a_scene_alike(name, kind):
    file = exported(name, kind)["scene"]
    plant = parsed(file.path)
    context = plant.CreateDefaultContext()
    for joint in file.model.joints:
        if joint.kind != "fixed":
            found = plant.GetJointByName(joint.name)
            plant.SetPositions(context, _positions(plant, context, found, joint.start))
    for link in file.model.links:
        if not (link.free and kind == "urdf"):  # Drake takes no floating joints there
            X_WL = plant.GetBodyByName(link.name).EvalPoseInWorld(context)
            assert X_WL.IsNearlyEqualTo(link.X_WL, 1e-9), link.name


def _positions(plant, context, joint, value):
    q = plant.GetPositions(context)
    q[joint.position_start()] = value
    return q


@pytest.mark.parametrize(("name", "part"), CASES)
def test_mujoco_reads_the_same_links_and_joints(mujoco, name, part):
    file = exported(name, "mjcf")[part]
    model = mujoco.MjModel.from_xml_path(str(file.path))
    compare_with_mujoco(mujoco, file.model, model)
    for joint in file.model.joints:
        if joint.kind != "fixed":
            dof = model.joint(joint.name).dofadr[0]
            assert model.dof_damping[dof] == pytest.approx(joint.damping)
            assert model.dof_armature[dof] == pytest.approx(joint.armature)
    mimics = [joint for joint in file.model.joints if joint.mimic]
    assert model.neq == len(mimics) + len(file.model.loops)


@pytest.mark.parametrize(("name", "part"), CASES)
def test_mujoco_reads_the_urdf_too(mujoco, name, part):
    file = exported(name, "urdf")[part]
    model = mujoco.MjModel.from_xml_path(str(file.path))
    compare_with_mujoco(mujoco, file.model, model)


def compare_with_mujoco(mujoco, model, found):
    for link in links(model):
        body = found.body(link.name)
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, body.iquat)
        axes = axes.reshape(3, 3)
        central = axes @ np.diag(body.inertia) @ axes.T
        assert body.mass[0] == pytest.approx(link.mass)
        np.testing.assert_allclose(body.ipos, link.p_LC, atol=1e-9)
        np.testing.assert_allclose(central, link.I_C, rtol=1e-6, atol=1e-10)
    for joint in model.joints:
        if joint.kind == "fixed":
            continue
        limited = math.isfinite(joint.lower) and math.isfinite(joint.upper)
        assert (
            found.joint(joint.name).type[0]
            == {
                "revolute": mujoco.mjtJoint.mjJNT_HINGE,
                "prismatic": mujoco.mjtJoint.mjJNT_SLIDE,
            }[joint.kind]
        )
        assert bool(found.jnt_limited[found.joint(joint.name).id]) == limited
        if limited:
            limits = [joint.lower, joint.upper]
            np.testing.assert_allclose(found.joint(joint.name).range, limits)


@pytest.mark.parametrize("name", SCENARIOS)
def test_mujoco_places_the_links_of_a_scene_alike(mujoco, name):
    file = exported(name, "mjcf")["scene"]
    model = mujoco.MjModel.from_xml_path(str(file.path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    for link in file.model.links:
        body = data.body(link.name)
        X_WL = RigidTransform(RotationMatrix(body.xmat.reshape(3, 3)), body.xpos)
        assert X_WL.IsNearlyEqualTo(link.X_WL, 1e-9), link.name
    # Loops and mimic joints hold there.
    equality = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert np.abs(data.efc_pos[equality]).max(initial=0.0) < 1e-6


@pytest.mark.parametrize(("name", "part"), CASES)
def test_a_reader_of_urdf_finds_the_same(yourdfpy, name, part):
    file = exported(name, "urdf")[part]
    robot = yourdfpy.URDF.load(str(file.path), load_collision_meshes=True)
    assert robot.validate(), robot.errors
    for link in links(file.model):
        inertial = robot.link_map[link.name].inertial
        assert inertial.mass == pytest.approx(link.mass)
        np.testing.assert_allclose(inertial.origin[:3, 3], link.p_LC, atol=1e-12)
        np.testing.assert_allclose(inertial.inertia, link.I_C, rtol=1e-9, atol=1e-15)
    for joint in file.model.joints:
        found = robot.joint_map[joint.name]
        assert (found.parent, found.child) == (joint.parent, joint.child)
        if math.isfinite(joint.upper):
            limits = [found.limit.lower, found.limit.upper, found.limit.effort]
            assert limits == pytest.approx([joint.lower, joint.upper, joint.effort])
        if joint.mimic:
            assert found.mimic.joint == joint.mimic.joint
            assert found.mimic.multiplier == joint.mimic.multiplier


@pytest.mark.parametrize("kind", ["urdf", "mjcf", "sdf"])
@pytest.mark.parametrize("name", SCENARIOS)
def test_meshes_are_beside_the_models_and_no_path_is_absolute(name, kind):
    for file in exported(name, kind).values():
        text = file.path.read_text()
        assert "package://" not in text
        assert "file://" not in text
        folder = file.path.parent / ("meshes" if kind == "mjcf" else "")
        for element in ET.fromstring(text).iter():
            for uri in (element.get("filename"), element.get("file")):
                assert uri is None or (folder / uri).is_file()
                assert uri is None or not uri.startswith("/")
            if element.tag == "uri":
                assert (folder / element.text).is_file()
                assert not element.text.startswith("/")
