import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper import LinkageDriver, SrgPositionDriver, SrgTendonDriver
from drake_srg.gripper.drivers import AddGripperDriver
from drake_srg.parsing import AddModel
from gripper import linkage_hand, srg_hand


@pytest.mark.parametrize(
    ("model", "config", "allowed"),
    [
        (
            "srg",
            LinkageDriver(),
            "!SrgPositionDriver, !SrgTendonDriver, !PlantServoDriver",
        ),
        ("linkage_gripper", SrgPositionDriver(), "!LinkageDriver"),
        ("linkage_gripper", SrgTendonDriver(), "!LinkageDriver"),
        ("table", LinkageDriver(), "none"),
    ],
)
def test_a_driver_of_another_gripper_is_refused(model, config, allowed):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.005)
    gripper = AddModel(plant, f"package://drake_srg/sdf/{model}.sdf")
    plant.Finalize()
    with pytest.raises(ScenarioError) as error:
        AddGripperDriver(builder, plant, gripper, config)
    name = type(config).__name__
    assert str(error.value) == (
        f"gripper: !{name} does not fit the model; allowed: {allowed}"
    )


@pytest.mark.parametrize("driver", [SrgPositionDriver, SrgTendonDriver])
def test_the_literal_law_pushes_until_its_reference_arrives(driver):
    config = driver()
    config.servo.law = "literal"
    hand = srg_hand.Hand(config=config)
    hand.command(closure_commanded=0.1)
    hand.advance(0.05)
    assert hand.read("pwm")[0] > 0.1
    hand.advance(1.0)
    # Where the fingers are by now does not matter.
    assert hand.read("pwm") == pytest.approx(np.zeros(config.num_motors), abs=1e-12)


def test_the_literal_law_is_refused_where_references_have_no_targets():
    config = LinkageDriver()
    config.servo.law = "literal"
    with pytest.raises(ValueError, match=r"servo\.law: .* here: pid, printed"):
        linkage_hand.Hand(config=config)


def test_the_law_of_the_plant_is_refused_where_a_motor_pulls_wires():
    config = SrgTendonDriver()
    config.servo.law = "plant"
    with pytest.raises(ValueError, match=r"^gripper\.servo\.law: must be one of pid, "):
        srg_hand.Hand(config=config)
