"""The thesis's demonstration, played in a quarter of its time; see docs/kitchen.md."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.systems import output_ports
from drake_srg.lifetime import LeafSystem
from drake_srg.objects.poses import ContactReader
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.station import MakeCell, MakeStation
from drake_srg.station.perception import AddLocalizer

RATE = 125.0  # messages/s: the fingers close and open in 8 s
# Seconds per pose: a little more than the arm needs within its limits. A motion that
# starts before the last one has ended would take another path.
POSES = {
    "startpos": [4.2],
    "movetocup": [4.2, 2.4, 1.6],
    "lift": [3.6],
    "placeposition": [3.4],
    "secure_start_position": [1.6, 2.4, 1.6],
}
GRIP_AND_LIFT = (
    "planner.messages.sequence=[{routine: grip, mode: close}, "
    "{routine: lift, mode: lift}]"
)


# Longer steps and a coarser contact mesh than the scenario's.
COARSER = ("plant_config.time_step=0.008", "object.resolution=0.018")


def faster(name, *overrides, rate=RATE):
    counts = [
        f"planner.messages.routines.{routine}.{i}.count={round(time * rate)}"
        for routine, times in POSES.items()
        for i, time in enumerate(times)
    ]
    return load_scenario(
        name, overrides=[f"planner.messages.rate={rate}", *counts, *overrides]
    )


def at_the_cup(name):
    """Return the override that has the arm begin in the last pose of movetocup."""
    pose = load_scenario(name).planner.messages.routines["movetocup"][-1].kuka
    return f"arm.home={np.deg2rad(pose).tolist()}"


class Touched(LeafSystem):
    """Collects the names of everything that arm and gripper touch."""

    def __init__(self):
        super().__init__()
        self.names = {"arm": set(), "gripper": set()}
        self.DeclareAbstractInputPort("contacts", AbstractValue.Make(ContactResults()))
        self.DeclarePeriodicPublishEvent(0.02, 0.0, self.look)

    def look(self, context):
        contacts = self.get_input_port().Eval(context)
        for name, touched in self.names.items():
            touched.update(ContactReader(contacts.plant(), name).forces(contacts))


def watched(touched):
    """Return a function that makes a cell with `touched` connected to it."""

    def make_cell(scenario):
        builder = DiagramBuilder()
        cell = builder.AddSystem(MakeCell(scenario))
        builder.AddSystem(touched)
        builder.Connect(
            cell.GetOutputPort("contact_results_cheat"), touched.get_input_port()
        )
        for name, port in output_ports(cell).items():
            builder.ExportOutput(port, name)
        return builder.Build()

    return make_cell


@pytest.mark.slow
def test_the_can_is_carried_around_and_put_back():
    touched = Touched()
    # The fingers open and start no wider than needed.
    scenario = faster(
        "thesis_kitchen",
        *COARSER,
        "planner.messages.routines.grip.0.grasp=[250, 1000]",
        "planner.messages.routines.open_full.0.grasp=[1000, 250]",
    )
    home = scenario.planner.messages.sequence.pop(0)  # the arm is there already
    assert home.routine == "startpos"
    result = Simulate(scenario, record=False, make_cell=watched(touched))
    metrics = result.metrics
    assert (metrics.success, metrics.failure) == (True, None)
    assert np.linalg.norm(metrics.placement_error_m) < 3e-3
    assert metrics.placement_tilt_rad < np.deg2rad(1.0)
    z = result.log["object_pose.soup_can"][:, 2]
    assert np.max(z) > 1.3  # above the upright arm
    assert touched.names == {"arm": set(), "gripper": {"soup_can"}}
    # The arm keeps the thesis's limits, by differences of commands sampled every 20 ms.
    q = result.log["arm.position_commanded"]
    v = np.diff(q, axis=0) / scenario.recording.period
    assert np.max(np.abs(v)) <= np.deg2rad(110.0)
    a = np.diff(v, axis=0) / scenario.recording.period
    assert np.max(np.abs(a)) <= np.deg2rad(40.0) * 1.001


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "changes", "lifted"),
    [
        ("thesis_kitchen_tendon", ["object.friction=0.7"], True),
        # The test above lifts the can with the same steps and mesh.
        ("thesis_kitchen", ["object.friction=0", *COARSER], False),
    ],
)
def test_only_friction_lifts_the_can(name, changes, lifted):
    # A can that comes back to its place within 3 mm needs slower fingers.
    overrides = (at_the_cup(name), GRIP_AND_LIFT, *changes)
    scenario = faster(name, *overrides, rate=2 * RATE)
    result = Simulate(scenario, record=False)
    z = result.log["object_pose.soup_can"][:, 2]
    assert (z[-1] > z[0] + 0.2) == lifted
    assert result.metrics.failure == "misplaced"  # it did not come back


@pytest.mark.slow
def test_the_ceiling_camera_finds_the_can():
    scenario = load_scenario("thesis_kitchen")
    builder = DiagramBuilder()
    station = builder.AddSystem(MakeStation(scenario))
    localizer = AddLocalizer(builder, scenario, station)
    diagram = builder.Build()
    context = localizer.GetMyContextFromRoot(diagram.CreateDefaultContext())
    (blob,) = localizer.GetOutputPort("blobs").Eval(context)
    truth = [*scenario.objects["soup_can"].position, 0.0175 + 0.0509]
    np.testing.assert_allclose(blob.position, truth, atol=0.5e-3)  # the kitchen's aim
