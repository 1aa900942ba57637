"""The fast scenarios, and what continuous plants (CENIC) need."""

import numpy as np
import pytest
from helpers import port_table

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.station import MakeCell, MakeStation

pytestmark = pytest.mark.slow

CENIC = "simulator_config.integration_scheme=cenic"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return a whole cycle, recorded with few and small pictures."""
    out = tmp_path_factory.mktemp("fast")
    overrides = [
        "cameras.overview.width=160",
        "cameras.overview.height=90",
        "recording={video_fps: 1.0, bag_camera_period: 1.0}",
    ]
    scenario = load_scenario("kitchen_fast", seed=1, overrides=overrides)
    return Simulate(scenario, name="kitchen_fast", out=out), out


def test_the_fast_kitchen_places_its_can_within_2_mm(run):
    metrics = run[0].metrics
    assert metrics.success
    assert metrics.attempts == 1
    assert np.all(np.abs(metrics.placement_error_m[:2]) < 0.002)
    assert metrics.placement_tilt_rad < np.deg2rad(1.0)


def test_the_fast_kitchen_is_recorded(run):
    files = {path.name for path in run[1].iterdir()}
    assert files >= {"video.mp4", "recording.mcap", "log.npz", "metrics.json"}


def test_the_fingers_of_the_fast_arm_meet_only_with_their_pads():
    station = MakeStation(load_scenario("assistive_arm_fast"))
    inspector = station.GetSubsystemByName("scene_graph").model_inspector()
    pairs = [
        [inspector.GetName(geometry) for geometry in pair]
        for pair in inspector.GetCollisionCandidates()
    ]
    own = [p for p in pairs if all(name.startswith("gripper::") for name in p)]
    assert len(own) == 9  # three pads by three
    assert all("_pad_" in name for pair in own for name in pair)


def test_the_fast_kitchen_loses_a_can_without_friction():
    scenario = load_scenario(
        "kitchen_fast", overrides=["object.friction=0", "planner.max_attempts=1"]
    )
    result = Simulate(scenario)
    assert not result.metrics.success
    assert result.metrics.failure in ("no_grasp", "dropped")


def test_a_fast_cell_looks_like_any_other():
    fast, discrete = (MakeCell(load_scenario(n)) for n in ("kitchen_fast", "kitchen"))
    assert port_table(fast) == port_table(discrete)
    assert fast.GetSubsystemByName("station").HasSubsystemNamed("plant")


@pytest.mark.parametrize(
    ("name", "overrides", "message"),
    [
        ("kitchen", ["plant_config.time_step=0"], "plant_config.time_step: must be"),
        ("kitchen", [CENIC], "simulator_config.integration_scheme: cenic needs"),
        ("kitchen_fast", ["arm.period=0.01"], "arm.period: must be a multiple of"),
        ("kitchen_fast", ["gripper.servo.period=0.01"], "gripper.servo.period: must"),
        ("kitchen_fast", ["recording.video_fps=20"], "recording.video_fps: must be a"),
        ("kitchen_fast", ["recording.period=0.05"], "recording.period: must be a"),
        ("kitchen_fast", ["gripper=!SrgTendonDriver {}"], "gripper: !SrgTendonDriver"),
        (
            "kitchen",
            ["ignored_contacts=[[a]]"],
            r"ignored_contacts\[0\]: needs 2 names, got 1",
        ),
    ],
)
def test_settings_that_do_not_fit_together_are_refused(name, overrides, message):
    with pytest.raises(ScenarioError, match=message):
        load_scenario(name, overrides=overrides)


def test_ignored_contacts_must_match_some_geometry():
    scenario = load_scenario("kitchen", overrides=["ignored_contacts=[[arm::x, '*']]"])
    with pytest.raises(
        ScenarioError, match="ignored_contacts: no collision geometry matches 'arm::x'"
    ):
        MakeStation(scenario)


def test_ignored_contacts_are_filtered():
    def pairs(*overrides):
        station = MakeStation(load_scenario("kitchen", overrides=overrides))
        scene_graph = station.GetSubsystemByName("scene_graph")
        inspector = scene_graph.model_inspector()
        names = [
            tuple(sorted(inspector.GetName(g).split("::")[0] for g in pair))
            for pair in inspector.GetCollisionCandidates()
        ]
        return set(names)

    assert ("arm", "arm") in pairs()
    filtered = pairs("ignored_contacts=[['arm::*', 'arm::*']]")
    assert filtered == pairs() - {("arm", "arm")}
