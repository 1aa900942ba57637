import numpy as np
import pytest
from objects.meshes.made_meshes import box, write_obj

from drake_srg.common.exceptions import ScenarioError
from drake_srg.importing.arm_file import GivenLimits, read_arm
from importing.made_arms import joint, link, six_axes, two_axes

BODY = ("0 0 0.05", "0 0 0", 0.02, 0.1, 0.2)


def arm(tmp_path, text, tip="", **given):
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    return read_arm(path, tip, GivenLimits(**given))


def test_an_arm_is_read_from_base_to_tip(tmp_path):
    found = arm(tmp_path, six_axes())
    assert [link.name for link in found.links] == [f"link{i}" for i in range(7)]
    assert [joint.name for joint in found.joints][:2] == ["pan", "lift"]
    assert found.joints[0].effort == 200.0
    assert found.joints[2].upper == 3.0
    assert found.joints[0].acceleration == pytest.approx(10.0)  # in a quarter second
    assert any("acceleration" in warning for warning in found.warnings)
    np.testing.assert_allclose(found.joints[1].X_PC.translation(), [0, 0.13, 0])
    assert found.links[2].contents.mass == pytest.approx(6.0)
    # The frame for tools is the flange; its z points out of the arm.
    np.testing.assert_allclose(found.X_LT.translation(), [0, 0.08, 0], atol=1e-9)
    np.testing.assert_allclose(found.X_LT.rotation().col(2), [0, 1, 0], atol=1e-9)
    assert "tool0" in found.links[-1].frames


def test_limits_may_be_given(tmp_path):
    text = two_axes(replaced=[('velocity="2.5"', ""), ('effort="200"', 'effort="0"')])
    found = arm(tmp_path, text, velocity=[1.5], effort=[30, 20], acceleration=[4])
    assert [joint.velocity for joint in found.joints] == [1.5, 1.5]
    assert [joint.effort for joint in found.joints] == [30, 20]
    assert [joint.acceleration for joint in found.joints] == [4, 4]


def test_an_acceleration_in_the_file_holds(tmp_path):
    text = two_axes(replaced=[("<limit ", '<limit drake:acceleration="3" ')])
    found = arm(tmp_path, text)
    assert [joint.acceleration for joint in found.joints] == [3, 3]
    assert not any("acceleration" in warning for warning in found.warnings)


def test_fingers_and_hand_beyond_the_tip_are_left_out(tmp_path):
    hand = link("hand", *BODY) + link("left", *BODY) + link("right", *BODY)
    hand += joint("l", "0 0 0.1", "0 0 0", "0 1 0", 0.5, 1, "hand", "left")
    hand += joint("r", "0 0 0.1", "0 0 0", "0 1 0", 0.5, 1, "hand", "right").replace(
        "</joint>", '<mimic joint="l"/></joint>'
    )
    hand += """<joint name="mount" type="fixed"><origin xyz="0 0 0.42"/>
      <parent link="link2"/><child link="hand"/></joint>"""
    with pytest.raises(ScenarioError, match=r"several tips: left, right .*--tip hand"):
        arm(tmp_path, two_axes(hand))
    found = arm(tmp_path, two_axes(hand), "link2")
    assert [joint.name for joint in found.joints] == ["pan", "lift"]
    assert not found.links[-1].frames
    assert found.links[-1].contents.mass == pytest.approx(6.0)


def test_what_is_missing_is_mended_and_told(tmp_path):
    """Without inertia, frame for tools, or a visual mesh that can be read."""
    write_obj(tmp_path / "hull.obj", box([0.1, 0.1, 0.3], [0, 0, 0.15]))
    (tmp_path / "seen.dae").write_text("<COLLADA/>")
    mesh = """<link name="link3">
      <visual><geometry><mesh filename="seen.dae"/></geometry></visual>
      <collision><geometry><mesh filename="package://any/hull.obj"/></geometry>
      </collision></link>"""
    mesh += joint("roll", "0 0 0.42", "0 0 0", "0 0 1", 2, 20, "link2", "link3")
    package = "<package><name>any</name></package>"
    (tmp_path / "package.xml").write_text(package)
    found = arm(tmp_path, two_axes(mesh))
    last = found.links[-1].contents
    assert last.mass == pytest.approx(1000 * 0.1 * 0.1 * 0.3)
    assert len(last.visuals) == len(last.collisions) == 1
    assert found.X_LT.translation()[2] == pytest.approx(0.3)
    told = "\n".join(found.warnings)
    for words in ("link3: no mass", "in .dae are not read", "outer face, 300 mm"):
        assert words in told


def test_the_flange_is_on_the_outer_face_along_any_axis(tmp_path):
    tilted = [
        ('axis xyz="0 1 0"', 'axis xyz="0 -0.6 0.8"'),
        ('xyz="0 0 0.21" rpy="0 0 0"', 'xyz="0 0 0" rpy="0.643501109 0 0"'),
    ]
    found = arm(tmp_path, two_axes(replaced=tilted))
    half = 0.19  # of the cylinder's length
    out = np.abs(found.X_LT.translation())
    np.testing.assert_allclose(out, half * np.array([0, 0.6, 0.8]), atol=1e-6)


def test_an_sdf_with_offset_frames_is_read(tmp_path):
    path = tmp_path / "arm.sdf"
    shape = "<geometry><sphere><radius>0.05</radius></sphere></geometry>"
    limit = "<lower>-1</lower><upper>1</upper><effort>9</effort><velocity>1</velocity>"
    path.write_text(f"""<sdf version="1.9"><model name="m">
      <link name="a"><collision name="c">{shape}</collision></link>
      <link name="b"><pose>0 0 0.5 0 0 0</pose>
        <inertial><mass>2</mass></inertial>
        <visual name="v"><pose relative_to="b">0 0 0.1 0 0 0</pose>{shape}</visual>
      </link>
      <joint name="j" type="revolute"><pose>0 0 -0.2 0 0 0</pose>
        <parent>a</parent><child>b</child>
        <axis><xyz>0 1 0</xyz><limit>{limit}</limit></axis></joint>
    </model></sdf>""")
    found = read_arm(path)
    (only,) = found.joints
    np.testing.assert_allclose(only.X_PC.translation(), [0, 0, 0.5], atol=1e-12)
    np.testing.assert_allclose(only.X_CJ.translation(), [0, 0, -0.2], atol=1e-12)
    assert found.links[1].contents.mass == 2.0


LOOP = joint("again", "0 0 0", "0 0 0", "0 0 1", 1, 1, "link0", "link2")
FLOATING = """<link name="ground"/><joint name="free" type="floating">
  <parent link="ground"/><child link="link0"/></joint>"""
NO_MASS = [("<inertial>", "<!--"), ("</inertial>", "-->")]
NO_MASS += [("<visual>", "<!--"), ("</collision>", "-->")]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot name='x'><link name='a'/></robot>", ["no joints"]),
        (two_axes(replaced=[('type="revolute"', 'type="fixed"')]), ["no joints that"]),
        (two_axes(LOOP), ["link2: lift and again close a chain"]),
        (two_axes(FLOATING), ["joint free", "the base floats"]),
        (two_axes(link("other", *BODY)), ["one base, got link0, other"]),
        (two_axes(replaced=[('velocity="2.5"', "")]), ["pan: has no velocity limit"]),
        (two_axes(replaced=[('effort="200"', "")]), ["no effort limit", "--effort"]),
        (two_axes(replaced=[("lower", "low"), ("upper", "up")]), ["no room to move"]),
        (
            two_axes(replaced=[('effort="200"', 'effort="x"')]),
            ["effort: needs a finite"],
        ),
        (two_axes(replaced=NO_MASS), ["neither mass nor geometry (zero inertia)"]),
        (
            two_axes(replaced=[('<axis xyz="0 1 0"/>', '<mimic joint="pan"/>')]),
            ["joint lift", "mimic"],
        ),
        (
            two_axes(replaced=[('<cylinder radius="0.06" length="0.14"/>', "<mesh/>")]),
            ["its mesh '' does not exist"],
        ),
        (
            two_axes(replaced=[("link0", "world")]),
            ["joint pan: needs a link as its parent"],
        ),
    ],
)
def test_bad_arms_are_told_in_one_line(tmp_path, text, words):
    with pytest.raises(ScenarioError) as error:
        arm(tmp_path, text)
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith(f"{tmp_path / 'arm.urdf'}: ")
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"effort": [1, 2, 3]}, "--effort: needs one number, or one per joint (2)"),
        ({"velocity": [-1]}, "--velocity: must be greater than 0"),
    ],
)
def test_bad_limits_are_told(tmp_path, given, words):
    with pytest.raises(ScenarioError) as error:
        arm(tmp_path, two_axes(), **given)
    assert words in str(error.value)


def test_an_unknown_tip_is_told_with_the_known(tmp_path):
    with pytest.raises(ScenarioError, match=r"--tip: unknown link 'tool' .*tool0"):
        arm(tmp_path, six_axes(), "tool")
