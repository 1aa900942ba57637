"""Falling objects start apart.

Plants of a scenario's models.
"""

import contextlib
import os

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import AddModel, ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.systems import contact_approximations, takes_loop_constraints
from drake_srg.objects.config import ObjectConfig
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station import MakeStation
from drake_srg.station import plant as preflight
from drake_srg.station.plant import AddPlant, Drops, MakeModelsPlant, check_constraints
from drake_srg.types import Box

TABLE = 0.1
angles = st.floats(-np.pi, np.pi)
poses = st.builds(
    lambda r, p, y, x1, x2: RigidTransform(RollPitchYaw(r, p, y), [x1, x2, 0.0]),
    *(angles, angles, angles),
    *(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
)
sizes = st.lists(st.floats(0.01, 0.2), min_size=3, max_size=3)
things = st.lists(st.tuples(sizes, poses, st.floats(0.0, 0.05)), min_size=1, max_size=4)


def corners(size, X_WO):
    signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1)
    return (X_WO @ (signs * np.array(size)[:, None])).T


@given(things)
def test_boxes_around_falling_things_do_not_overlap(things):
    drops, boxes = Drops(TABLE), []
    for size, X_WO, height in things:
        config = ObjectConfig(shape=Box(size), mass=1.0, friction=1.0, drop=height)
        start = drops.X_WO_start("thing", config, X_WO)
        np.testing.assert_allclose(start.translation()[:2], X_WO.translation()[:2])
        R_WO = X_WO.rotation().matrix()
        np.testing.assert_array_equal(start.rotation().matrix(), R_WO)
        points = corners(size, start)
        low, high = points.min(axis=0), points.max(axis=0)
        assert low[2] >= TABLE + height - 1e-9
        for below, above in boxes:
            assert np.any((low > above - 1e-9) | (high < below + 1e-9))
        boxes.append((low, high))


def test_a_thing_alone_starts_at_its_drop_height():
    config = ObjectConfig(shape=Box([0.1, 0.2, 0.3]), mass=1.0, friction=1.0, drop=0.01)
    X_WO = RigidTransform(RollPitchYaw(0.5 * np.pi, 0.0, 0.0), [0.0, 0.0, 5.0])
    start = Drops(TABLE).X_WO_start("thing", config, X_WO)
    np.testing.assert_allclose(start.translation()[2], TABLE + 0.01 + 0.1)


RED = [0.8, 0.1, 0.08]


def red_pixels(*overrides, seed=0):
    """Return where the ceiling camera sees the kitchen's can, shape (240, 320)."""
    fixed = (
        "object.model=null",
        "object.shape=!Cylinder {radius: 0.034, length: 0.01}",
        f"object.color={RED}",
    )
    scenario = load_scenario("kitchen", seed=seed, overrides=[*fixed, *overrides])
    station = MakeStation(scenario)
    image = station.GetOutputPort("camera_ceiling.color_image")
    pixels = image.Eval(station.CreateDefaultContext()).data[..., :3].astype(float)
    return (pixels[..., 0] > 2.0 * pixels[..., 1]) & (pixels[..., 0] > 40.0)


@pytest.fixture(scope="module")
def whole():
    """Return the pixels in which the camera sees the can without a card."""
    return red_pixels()


@pytest.mark.slow
@given(share=st.floats(0.05, 0.95), direction=st.floats(0.0, 6.28))
@settings(max_examples=6)
def test_a_card_hides_its_share_of_the_width(whole, share, direction):
    seen = red_pixels(f"object.occlusion={{share: {share}, direction: {direction}}}")
    # Pixels on the rim mix with their neighbours.
    assert not np.any(seen & (cv2.dilate(whole.astype(np.uint8), np.ones((3, 3))) == 0))
    v, u = np.nonzero(whole)
    # World's x points up in the image, and its y to the left.
    along = np.array([-np.sin(direction), -np.cos(direction)]) @ [u, v]
    width = along.max() - along.min()
    along_seen = along[seen[v, u]]
    hidden = (along.max() - along_seen.max()) / width
    assert along_seen.min() - along.min() < 2.0  # nothing on the other side
    # One pixel on either side of an edge, and one for the slanted view.
    assert abs(hidden - share) < 3.0 / width


@pytest.mark.slow
def test_a_share_of_zero_hides_nothing(whole):
    np.testing.assert_array_equal(red_pixels("object.occlusion={share: 0.0}"), whole)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("localizer.cameras=[]", "needs at least one camera in localizer.cameras"),
        (
            "cameras.ceiling.X_PB.base_frame=arm::flange",
            "needs a first localizer camera that is fixed in world, got",
        ),
    ],
)
def test_errors_name_the_key(override, message):
    with pytest.raises(ScenarioError, match=f"objects.soup_can.occlusion: {message}"):
        red_pixels("object.occlusion={share: 0.5}", override)


NEEDS_TAMSI = pytest.mark.skipif(
    "tamsi" not in contact_approximations(), reason="this Drake has no TAMSI"
)
INERTIAL = "<inertial><mass>1</mass></inertial>"
URDF_INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
    'iyz="0"/></inertial>'
)
MIMIC = 'joint="one" multiplier="1" offset="0"'
BALL = """<drake:ball_constraint name="ball">
<drake:ball_constraint_body_A>a</drake:ball_constraint_body_A>
<drake:ball_constraint_body_B>b</drake:ball_constraint_body_B>
<drake:ball_constraint_p_AP>1 0 0</drake:ball_constraint_p_AP>
<drake:ball_constraint_p_BQ>1 0 0</drake:ball_constraint_p_BQ>
</drake:ball_constraint>"""
TENDON = """<drake:tendon_constraint name="tendon">
<drake:tendon_constraint_joint name="one" a="1"/>
<drake:tendon_constraint_offset>0</drake:tendon_constraint_offset>
<drake:tendon_constraint_lower_limit>-1</drake:tendon_constraint_lower_limit>
<drake:tendon_constraint_upper_limit>1</drake:tendon_constraint_upper_limit>
<drake:tendon_constraint_stiffness>1000</drake:tendon_constraint_stiffness>
<drake:tendon_constraint_damping>1</drake:tendon_constraint_damping>
</drake:tendon_constraint>"""
PLAIN_MIMIC = """<mimic joint="one"><multiplier>1</multiplier><offset>0</offset>
<reference>0</reference></mimic>"""


def sdf(*, axis="", joint="", model=""):
    return f"""<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="m">
<link name="a">{INERTIAL}</link><link name="b">{INERTIAL}</link>
<joint name="one" type="revolute"><parent>world</parent><child>a</child>
<axis><xyz>0 0 1</xyz></axis></joint>
<joint name="two" type="revolute"><parent>a</parent><child>b</child>
<axis><xyz>0 0 1</xyz>{axis}</axis>{joint}</joint>{model}</model></sdf>"""


def urdf(joint):
    return f"""<robot name="m" xmlns:drake="http://drake.mit.edu">
<link name="a">{URDF_INERTIAL}</link><link name="b">{URDF_INERTIAL}</link>
<joint name="one" type="continuous"><parent link="world"/><child link="a"/></joint>
<joint name="two" type="continuous"><parent link="a"/><child link="b"/>{joint}</joint>
</robot>"""


MODELS = {
    "mimic.sdf": sdf(joint=f"<drake:mimic {MIMIC}/>"),
    "ball.sdf": sdf(model=BALL),
    "tendon.sdf": sdf(model=TENDON),
    "plain_mimic.sdf": sdf(axis=PLAIN_MIMIC),
    "misplaced_mimic.sdf": sdf(axis=f"<drake:mimic {MIMIC}/>"),
    "both_mimics.sdf": sdf(axis=PLAIN_MIMIC, joint=f"<drake:mimic {MIMIC}/>"),
    "commented.sdf": sdf(axis=f"<!-- {PLAIN_MIMIC} -->"),
    "free.sdf": sdf(),
    "mimic.urdf": urdf(f"<mimic {MIMIC}/>"),
    "drake_mimic.urdf": urdf(f"<drake:mimic {MIMIC}/>"),
    "including.sdf": """<sdf version="1.9"><model name="m"><include>
<name>inner</name><uri>file://FOLDER/ball.sdf</uri></include></model></sdf>""",
    "ball.xml": """<mujoco model="m"><worldbody><body name="a">
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint name="one"/></body><body
name="b"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint name="two"/></body>
</worldbody><equality><connect body1="a" body2="b" anchor="0 0 1"/></equality>
</mujoco>""",
}
SOLVERS = {
    "lagged": MultibodyPlantConfig(time_step=0.005),
    "tamsi": MultibodyPlantConfig(
        time_step=0.005, discrete_contact_approximation="tamsi"
    ),
    "cenic": MultibodyPlantConfig(time_step=0.0),
}


@pytest.fixture(params=[False, True], ids=["cenic refuses loops", "takes loops"])
def takes_loops(request, monkeypatch):
    monkeypatch.setattr(preflight, "takes_loop_constraints", lambda: request.param)
    return request.param


@pytest.fixture
def scenario_with(tmp_path):
    for name, text in MODELS.items():
        (tmp_path / name).write_text(text.replace("FOLDER", str(tmp_path)))

    def make(model, solver):
        url = model if "://" in model else f"file://{tmp_path}/{model}"
        directive = ModelDirective(add_model=AddModel(name="gripper", file=url))
        return Scenario(plant_config=SOLVERS[solver], directives=[directive])

    return make


@pytest.mark.parametrize(
    ("model", "solver", "said"),
    [
        ("mimic.sdf", "tamsi", ["drake:mimic", "tamsi", "sap, similar or lagged"]),
        ("mimic.urdf", "tamsi", ["<mimic>", "tamsi", "sap, similar or lagged"]),
        ("ball.sdf", "tamsi", ["drake:ball_constraint", "tamsi", "lagged"]),
        ("tendon.sdf", "tamsi", ["drake:tendon_constraint", "tamsi", "lagged"]),
        ("tendon.sdf", "cenic", ["drake:tendon_constraint", "cenic", "time_step"]),
        ("plain_mimic.sdf", "lagged", ["<mimic>", "ignores", "<drake:mimic>"]),
        ("misplaced_mimic.sdf", "lagged", ["<drake:mimic>", "directly in the joint"]),
        ("drake_mimic.urdf", "lagged", ["<drake:mimic>", "allowed: <mimic>"]),
    ],
)
def test_an_unsupported_constraint_is_reported_in_one_line(
    scenario_with, takes_loops, model, solver, said
):
    check_refusal(scenario_with(model, solver), said)


def check_refusal(scenario, said):
    with pytest.raises(ScenarioError) as error:
        AddPlant(DiagramBuilder(), scenario)
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith("directives: gripper: ")
    for words in said:
        assert words in message


LOOPS = [
    ("ball.sdf", ["ball.sdf", "drake:ball_constraint", "drake:mimic", "1.58"]),
    ("including.sdf", ["ball.sdf", "cenic", "drake:mimic"]),
    ("ball.xml", ["connect", "cenic"]),
]


@pytest.mark.parametrize(("model", "said"), LOOPS)
def test_a_loop_on_cenic_needs_a_drake_that_takes_it(
    scenario_with, takes_loops, model, said
):
    scenario = scenario_with(model, "cenic")
    if takes_loops:
        plant, _ = AddPlant(DiagramBuilder(), scenario)
        assert plant.num_constraints() == 1
    else:
        check_refusal(scenario, said)


@pytest.mark.parametrize("model", [model for model, _ in LOOPS])
def test_preflight_and_cenic_refuse_the_same_loops(scenario_with, monkeypatch, model):
    monkeypatch.setattr(preflight, "takes_loop_constraints", lambda: True)
    builder = DiagramBuilder()
    AddPlant(builder, scenario_with(model, "cenic"))
    simulator = Simulator(builder.Build())
    config = SimulatorConfig(integration_scheme="cenic", max_step_size=0.01)
    ApplySimulatorConfig(config, simulator)
    if takes_loop_constraints():
        simulator.AdvanceTo(0.1)
    else:
        with pytest.raises(RuntimeError, match=r"1 ball constraint\(s\)"):
            simulator.AdvanceTo(0.1)


@pytest.mark.parametrize(
    ("model", "solver", "count"),
    [
        ("mimic.sdf", "lagged", 1),
        ("mimic.sdf", "cenic", 1),
        ("mimic.urdf", "lagged", 1),
        ("both_mimics.sdf", "lagged", 1),
        ("ball.sdf", "lagged", 1),
        ("tendon.sdf", "lagged", 1),
        ("including.sdf", "lagged", 1),
        ("ball.xml", "lagged", 1),
        pytest.param("free.sdf", "tamsi", 0, marks=NEEDS_TAMSI),
        ("free.sdf", "cenic", 0),
        ("commented.sdf", "lagged", 0),
    ],
)
def test_supported_constraints_are_in_the_plant(scenario_with, model, solver, count):
    plant, _ = AddPlant(DiagramBuilder(), scenario_with(model, solver))
    assert plant.num_constraints() == count


def test_a_missing_model_is_left_to_the_parser(scenario_with):
    scenario = scenario_with("missing.sdf", "lagged")
    check_constraints(scenario)
    with pytest.raises(ScenarioError, match=r"directives: .*missing\.sdf"):
        AddPlant(DiagramBuilder(), scenario)


@pytest.mark.parametrize("name", ("linkage_gripper", "linkage_gripper_flat"))
def test_the_linkage_needs_a_solver_with_ball_constraints(
    scenario_with, takes_loops, name
):
    url = f"package://drake_srg/sdf/{name}.sdf"
    with (
        contextlib.nullcontext()
        if takes_loops
        else pytest.raises(ScenarioError, match="cenic refuses")
    ):
        check_constraints(scenario_with(url, "cenic"))
    check_constraints(scenario_with(url.replace(name, "linkage_gripper_fast"), "cenic"))


FRAME = """directives:
- add_frame: {{name: tip, X_PF: {{base_frame: world, translation: [{x}, 0, 0]}}}}
"""


def test_the_models_plant_has_the_models_but_no_object():
    plant = MakeModelsPlant(load_scenario("kitchen"))
    assert plant.is_finalized()
    assert plant.HasModelInstanceNamed("arm")
    assert not plant.HasModelInstanceNamed("soup_can")


def test_seeds_share_a_models_plant():
    plants = [MakeModelsPlant(load_scenario("kitchen", seed=seed)) for seed in (0, 1)]
    assert plants[0] is plants[1]
    assert plants[0] is not MakeModelsPlant(load_scenario("kitchen_fast"))


@pytest.mark.slow
def test_changed_directives_are_read_again(tmp_path):
    path = tmp_path / "frames.dmd.yaml"
    entry = f"{{add_model: null, add_directives: {{file: {path.as_uri()}}}}}"
    override = f"directives.floor={entry}"
    for x in (0.1, 0.2):
        path.write_text(FRAME.format(x=x))
        plant = MakeModelsPlant(load_scenario("kitchen", overrides=[override]))
        frame = plant.GetFrameByName("tip")
        assert frame.GetFixedPoseInBodyFrame().translation()[0] == x


@pytest.mark.slow
def test_changed_models_are_read_again(tmp_path):
    path = tmp_path / "ball.sdf"
    override = f"directives.floor={{add_model: {{name: ball, file: {path.as_uri()}}}}}"
    model = '<sdf version="1.9"><model name="ball"><link name="{}"/></model></sdf>'
    for i, link in enumerate(("red", "green")):
        path.write_text(model.format(link))
        os.utime(path, ns=(i, i))  # file systems have coarse clocks
        plant = MakeModelsPlant(load_scenario("kitchen", overrides=[override]))
        assert plant.HasBodyNamed(link)


def test_a_missing_file_is_reported():
    scenario = load_scenario(
        "kitchen",
        overrides=[
            "directives.table={add_model: null, add_directives: {file: file:///no.yaml}}"
        ],
    )
    with pytest.raises(ScenarioError, match=r"directives: .*no\.yaml"):
        MakeModelsPlant(scenario)


def test_what_leaves_the_cell_is_caught():
    scenario = load_scenario("gripper_bench", overrides=["object.friction=0"])
    builder = DiagramBuilder()
    plant, _ = AddPlant(builder, scenario)
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    body = plant.get_body(
        plant.GetBodyIndices(plant.GetModelInstanceByName(scenario.task.pick))[0]
    )
    plant.SetFreeBodyPose(context, body, RigidTransform([100.0, 0.0, 0.0]))
    simulator.AdvanceTo(2.0)
    z = plant.EvalBodyPoseInWorld(context, body).translation()[2]
    assert -5.0 < z - scenario.table.height < -4.5


def test_a_lasting_floor_is_not_exported():
    plant, _ = AddPlant(DiagramBuilder(), load_scenario("gripper_bench"), catch=False)
    assert not plant.GetCollisionGeometriesForBody(plant.world_body())
