import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.export.mjcf import moment_arm_error
from drake_srg.gripper.tendon import TendonDrive, wire_travel
from drake_srg.scenario import load_scenario

from .exported import exported

PAGE = Path(__file__).parents[2] / "docs" / "export.md"
DRIVER = load_scenario("kitchen_tendon").gripper
ANGLE = st.floats(0.0, 1.94)
SPEED = st.floats(-2.0, 2.0)


@pytest.fixture(scope="module")
def hand(mujoco):
    """MuJoCo's model and data of the gripper alone, without weight."""
    path = exported("kitchen_tendon", "mjcf")["gripper"].path
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.gravity[:] = 0.0
    return model, mujoco.MjData(model)


def dofs(model):
    return [model.joint(name).dofadr[0] for name in DRIVER.joint_names]


@pytest.mark.parametrize("name", ["gripper", "scene"])
def test_moment_arms_are_within_three_in_a_thousand(name):
    assert moment_arm_error(exported("kitchen_tendon", "mjcf")[name].wires) < 0.003


def test_grippers_without_wires_have_no_tendons():
    assert exported("loops", "mjcf")["gripper"].wires is None


@given(
    q=st.lists(ANGLE, min_size=4, max_size=4),
    v=st.lists(SPEED, min_size=4, max_size=4),
    stretch=st.floats(1e-3, 4e-3),
)
def test_taut_tendons_pull_as_the_drive_does(mujoco, hand, q, v, stretch):
    model, data = hand
    config = DRIVER.drive
    slide, fingers = model.joint("wire_slide").dofadr[0], dofs(model)
    travel = max(wire_travel(q[0], q[2]), wire_travel(q[1], q[3])) + stretch
    data.qpos[slide], data.qpos[fingers] = travel, q
    data.qvel[slide], data.qvel[fingers] = 0.0, v
    mujoco.mj_forward(model, data)

    drive = TendonDrive(config, 0.002)
    context = drive.CreateDefaultContext()
    drive.GetInputPort("pwm").FixValue(context, [0.0])
    drive.GetInputPort("state_measured").FixValue(context, [*q, *v])
    context.SetDiscreteState([travel / config.spool_radius, 0.0])
    torque = drive.GetOutputPort("joint_torque").Eval(context)

    found = data.qfrc_passive[fingers] + config.joint_damping * np.array(v)
    np.testing.assert_allclose(found, torque, rtol=0.005, atol=0.01)


def test_a_slack_tendon_does_not_push(mujoco, hand):
    model, data = hand
    mujoco.mj_resetData(model, data)
    slide, fingers = model.joint("wire_slide").dofadr[0], dofs(model)
    data.qpos[slide], data.qpos[fingers] = 0.0, 1.0
    mujoco.mj_forward(model, data)
    back = [
        *[DRIVER.drive.base_spring.preload + DRIVER.drive.base_spring.stiffness] * 2,
        *[DRIVER.drive.tip_spring.preload + DRIVER.drive.tip_spring.stiffness] * 2,
    ]
    np.testing.assert_allclose(data.qfrc_passive[fingers], np.negative(back))


def test_an_empty_hand_closes_in_mujoco_as_in_drake(mujoco, hand):
    """At 102.8 N, Drake's pads meet at base angles of 1.769 rad, tips straight."""
    model, data = hand
    mujoco.mj_resetData(model, data)
    data.ctrl[0] = DRIVER.drive.force_limit_of(102.8)
    while data.time < 3.0:
        mujoco.mj_step(model, data)
    force = model.tendon_stiffness * (data.ten_length - model.tendon_lengthspring[:, 1])
    # The closed hand may lean to a side: the fingers push each other there and back.
    assert force.mean() == pytest.approx(102.8, rel=0.02)
    assert data.qpos[dofs(model)][:2].mean() == pytest.approx(1.769, abs=0.02)
    np.testing.assert_allclose(data.qpos[dofs(model)][2:], 0.0, atol=0.02)


def test_the_example_of_the_page_closes_the_hand(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = exported("kitchen_tendon", "mjcf")["gripper"].path.parent
    Path("models").symlink_to(folder)
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.M)
    variables: dict = {}
    exec(compile(code, PAGE, "exec"), variables)
    closed = variables["data"].qpos[dofs(variables["model"])]
    assert closed[:2].mean() == pytest.approx(1.769, abs=0.02)
