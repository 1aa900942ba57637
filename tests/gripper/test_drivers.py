import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper.drivers import (
    AddGripperDriver,
    LinkageDriver,
    SrgPositionDriver,
    SrgTendonDriver,
)
from drake_srg.parsing import configure_parser


@pytest.mark.parametrize(
    ("model", "config", "allowed"),
    [
        ("srg", LinkageDriver(), "!SrgPositionDriver, !SrgTendonDriver"),
        ("linkage_gripper", SrgPositionDriver(), "!LinkageDriver"),
        ("linkage_gripper", SrgTendonDriver(), "!LinkageDriver"),
        ("table", LinkageDriver(), "none"),
    ],
)
def test_a_driver_of_another_gripper_is_refused(model, config, allowed):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.005)
    parser = Parser(plant)
    configure_parser(parser)
    (gripper,) = parser.AddModels(url=f"package://drake_srg/sdf/{model}.sdf")
    plant.Finalize()
    with pytest.raises(ScenarioError) as error:
        AddGripperDriver(builder, plant, gripper, config)
    name = type(config).__name__
    assert str(error.value) == (
        f"gripper: !{name} does not fit the model; allowed: {allowed}"
    )
