import dataclasses as dc

import pytest
from pydrake.systems.framework import DiagramBuilder

from drake_srg.cell.perception import AddLocalizer, AddObstacleFinder
from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation

pytestmark = pytest.mark.slow


def perceive(scenario, built=lambda: None):
    """Return blobs and obstacles that a scenario's cameras show at the start."""
    builder = DiagramBuilder()
    station = builder.AddNamedSystem("station", MakeStation(scenario))
    localizer = AddLocalizer(builder, scenario, station)
    finder = AddObstacleFinder(builder, scenario, station, localizer)
    context = builder.Build().CreateDefaultContext()
    built()
    return [
        system.get_output_port().Eval(system.GetMyContextFromRoot(context))
        for system in (localizer, finder)
    ]


def recorder(config, seen, path=""):
    """Return a copy of a config that notes the dotted path of every value read."""
    names = [field.name for field in dc.fields(config)]

    class Recorder(type(config)):
        def __getattribute__(self, name):
            value = super().__getattribute__(name)
            if name in names and not dc.is_dataclass(value):
                seen.add(path + name)
            return value

    values = {name: getattr(config, name) for name in names}
    return Recorder(
        **{
            name: recorder(value, seen, f"{path}{name}.")
            if dc.is_dataclass(value)
            else value
            for name, value in values.items()
        }
    )


def paths(config, path=""):
    """Return the dotted paths of all values of a config."""
    found = set()
    for field in dc.fields(config):
        value = getattr(config, field.name)
        name = path + field.name
        found |= paths(value, f"{name}.") if dc.is_dataclass(value) else {name}
    return found


def test_every_threshold_reaches_its_step():
    """In two scenes with noise, occlusion, other lights and clutter, all are read."""
    expected, seen = set(), set()
    for name, seed in (("assistive_arm_varied", 2), ("kitchen_varied", 0)):
        scenario = load_scenario(name, seed=seed)
        expected |= paths(scenario.localizer.thresholds)
        read = set()
        thresholds = recorder(scenario.localizer.thresholds, read)
        scenario.localizer.thresholds = thresholds
        perceive(scenario, built=read.clear)  # constructors only check thresholds
        seen |= read
    assert expected - seen == {"leveling.most_points"}  # the constructor reads it


@pytest.mark.parametrize(
    ("override", "which"),
    [
        ("fit.frayed=4.0", 0),
        ("sight.deviations=0.2", 0),
        ("obstacles.least_pixels=1000000", 1),
        ("leveling.most_points=300", 0),
    ],
)
def test_a_scenarios_thresholds_change_what_is_perceived(override, which):
    before, after = (
        perceive(load_scenario("kitchen_varied", seed=0, overrides=overrides))
        for overrides in ([], [f"localizer.thresholds.{override}"])
    )
    assert describe(after[which]) != describe(before[which])


def describe(found):
    return [
        [str(getattr(item, field.name)) for field in dc.fields(item)] for item in found
    ]


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
