import pytest
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation
from drake_srg.station.perception import AddLocalizer

pytestmark = pytest.mark.slow


def test_a_localizer_without_an_object_that_it_knows_is_refused():
    mug = "object.model=package://drake_srg/sdf/mug.sdf"
    scenario = load_scenario("kitchen", overrides=[mug])
    builder = DiagramBuilder()
    station = builder.AddNamedSystem("station", MakeStation(scenario))
    with pytest.raises(ScenarioError, match=r"^objects: the localizer knows none"):
        AddLocalizer(builder, scenario, station)


def test_the_thesis_s_localizer_takes_one_camera():
    scenario = load_scenario("assistive_arm_thesis", seed=0)
    scenario.localizer.cameras = ["ceiling", "overview"]
    builder = DiagramBuilder()
    with pytest.raises(
        ScenarioError, match=r"localizer\.cameras: must name one camera"
    ):
        AddLocalizer(builder, scenario, builder.AddSystem(MakeStation(scenario)))
