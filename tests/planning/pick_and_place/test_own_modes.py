"""Picking and placing with a mode of one's own, and machines of one's own."""

import dataclasses as dc
import runpy
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform

from drake_srg.common.log_format import MODES, logged_modes
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import (
    FATAL,
    TRANSITIONS,
    PlannerMemory,
)
from drake_srg.planning.pick_and_place.modes import task_modes
from drake_srg.planning.pick_and_place.planner import PickAndPlacePlanner
from drake_srg.planning.pick_and_place.sightings import PickTask
from drake_srg.planning.planner_machine import (
    Observation,
    PlannerConfig,
    PlannerMachine,
    PlannerMode,
    Transitions,
)
from drake_srg.planning.state_machine import Moment
from drake_srg.recording.replay.page import read_run
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.types import Failure, Mode, PlannerStatus
from planning.pick_and_place.test_modes import senses
from planning.planning_world import (
    CAN,
    CYCLE,
    GOAL,
    START,
    FakeTaskPlanner,
    World,
    blob,
)

BLOBS = AbstractValue.Make([])
# The test reads only the names of modes from the recording.
FEW_PICTURES = [
    "cameras.overview.width=160",
    "cameras.overview.height=90",
    "recording={video_fps: 1.0, bag_camera_period: 1.0}",
]


# The mode that docs/state_machine.md adds.
SHOWN = runpy.run_path(Path(__file__).parents[3] / "examples/extending/wiggle.py")
Own, Wiggle, TABLE = (SHOWN[n] for n in ("Own", "Wiggle", "OWN_TRANSITIONS"))
modes_with_wiggle = SHOWN["own_modes"]


def own_planner(**changes):
    own = {"make_modes": modes_with_wiggle, "transition": Transitions(TABLE, FATAL)}
    task = PickTask("can", CAN, RigidTransform(GOAL))
    return PickAndPlacePlanner(FakeTaskPlanner(), task, **{**own, **changes})


class OwnWorld(World):
    """A world whose fingers also hold in the mode that the test adds."""

    def _sense(self):
        super()._sense()
        if self.status.mode is Own.WIGGLE and self.holding(Own.WIGGLE):
            for name, value in (("grasped", [1.0]), ("proximity", np.zeros(4))):
                self.planner.GetInputPort(name).FixValue(self._context, value)


@pytest.fixture
def world(monkeypatch):
    monkeypatch.setattr(
        "planning.planning_world.make_planner",
        lambda task_planner, **config: own_planner(config=PlannerConfig(**config)),
    )
    return OwnWorld()


def test_a_cycle_passes_through_the_own_mode(world):
    assert world.run().done
    lift = CYCLE.index(Mode.LIFT)
    assert world.trace == [*CYCLE[:lift], Own.WIGGLE, *CYCLE[lift:]]


def test_an_object_lost_in_the_own_mode_is_noticed(world):
    world.holding = lambda mode: mode is not Own.WIGGLE
    world.where = lambda mode: [blob(START)]
    status = world.run()
    assert status.failure is Failure.DROPPED
    after = world.trace[world.trace.index(Own.WIGGLE) + 1]
    assert after is Mode.RELEASE


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"make_modes": task_modes},
            r"modes: no actions for Own.WIGGLE.*allowed: Mode",
        ),
        (
            {"make_modes": lambda *a: {Mode.IDLE: task_modes(*a)[Mode.IDLE]}},
            "no actions for Mode.PRE_GRASP, Mode.GRASP",
        ),
    ],
)
def test_a_mode_without_actions_is_refused_when_the_planner_is_made(changes, message):
    with pytest.raises(ValueError, match=message):
        own_planner(**changes)


def test_a_mode_without_a_row_is_refused_when_the_transitions_are_made():
    table = {**TRANSITIONS, Mode.VERIFY: [(lambda o, t, c: True, Own.WIGGLE)]}
    with pytest.raises(ValueError, match=r"Mode.VERIFY leads to Own.WIGGLE, which has"):
        Transitions(table)


def test_a_carrying_mode_that_forgets_its_base_is_told():
    wiggle = Wiggle(PlannerConfig(), None, 1)
    memory = PlannerMemory(Motion(np.zeros(2)))
    with pytest.raises(RuntimeError, match=r"grip.angles.*super\(\).enter"):
        wiggle.update(memory, Moment(0.0, senses()))


def test_a_mode_that_needs_a_plan_says_so():
    (release,) = (
        m for m in task_modes(PlannerConfig(), None, 1).values() if m.mode is Mode.CLOSE
    )
    with pytest.raises(RuntimeError, match="needs planned motions"):
        release.enter(PlannerMemory(Motion(np.zeros(2))), Moment(0.0, senses()))


@pytest.mark.slow
def test_a_run_with_an_own_mode_is_logged_recorded_and_judged(tmp_path):
    scenario = load_scenario("kitchen_fast", overrides=FEW_PICTURES)
    result = Simulate(scenario, out=tmp_path, make_planner=SHOWN["make_planner"])
    assert result.metrics.success, result.metrics.table()
    assert set(result.log["mode"]) >= {float(len(MODES)), 0.0}
    modes = logged_modes(result.log)
    assert modes.count("wiggle") >= 12  # every 0.05 s
    assert result.metrics.grasp_lifted
    assert "wiggle" in read_run(tmp_path).timeline.mode
    assert '"mode":"wiggle"' in (tmp_path / "replay.html").read_text()


@dc.dataclass
class Memory:
    """Commands of an arm that rests with open fingers."""

    motion: Motion
    closure: float = 0.0

    def status(self, mode):
        return PlannerStatus(mode=mode)


class Waiting(PlannerMode):
    """Waits in a mode."""

    def __init__(self, mode):
        self.mode = mode

    def observe_mode(self, memory, now):
        return Observation()


def waiting_machine(scenario):
    """Return a machine whose modes, but the first, are strings."""
    table = {
        Mode.IDLE: [(lambda o, t, c: t >= 0.1, "think_hard")],
        "think_hard": [(lambda o, t, c: t >= 0.2, "done")],
        "done": [],
    }
    planner = PlannerMachine(
        {mode: Waiting(mode) for mode in table},
        memory=Memory(Motion(np.array(scenario.arm.home))),
        transition=Transitions(table),
        config=PlannerConfig(),
    )
    planner.DeclareAbstractInputPort("blobs", BLOBS)
    return planner


@pytest.mark.slow
def test_a_machine_of_ones_own_ends_the_run_by_the_name_of_its_mode(tmp_path):
    scenario = load_scenario("kitchen_fast", overrides=FEW_PICTURES)
    result = Simulate(scenario, out=tmp_path, make_planner=waiting_machine)
    assert list(dict.fromkeys(logged_modes(result.log))) == [
        "idle",
        "think_hard",
        "done",
    ]
    assert result.status.done
    assert result.metrics.failure == "misplaced"  # nothing has been done
    assert result.metrics.sim_time_s < 1.0
    assert "think hard" in (tmp_path / "replay.html").read_text()
