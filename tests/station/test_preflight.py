import contextlib

import pytest
from pydrake.multibody.parsing import AddModel, ModelDirective
from pydrake.multibody.plant import MultibodyPlantConfig
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.drake_version import (
    contact_approximations,
    takes_loop_constraints,
)
from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import Scenario
from drake_srg.station import preflight
from drake_srg.station.plant import AddPlant
from drake_srg.station.preflight import check_constraints

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
