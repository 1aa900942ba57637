"""Trials of a policy in a scenario's cell, judged as in its environment."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.log_keys import pose_key
from drake_srg.envs.grasp_one_shot import GraspOneShotEnv
from drake_srg.envs.movers import MakeMover, joints_at
from drake_srg.envs.physics import DRIVER_TAGS
from drake_srg.envs.pick import PickEnv
from drake_srg.envs.rewards import LIFTED
from drake_srg.envs.workspace import Workspace
from drake_srg.learning.baselines import (
    BUILT_IN,
    RANDOM,
    named_rule,
    random_policy,
)
from drake_srg.learning.episodes import Act
from drake_srg.learning.grasp_planner import GraspPlanner
from drake_srg.learning.policy import Policy, check_sizes, load_policy
from drake_srg.learning.policy_planner import PolicyPlanner
from drake_srg.objects.models import known_shape, simple_shape
from drake_srg.scenario import Scenario
from drake_srg.simulation import Result, Simulate
from drake_srg.simulation.log_format import row_to_pose
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.sweeps.trial import TrialResult, run_trial
from drake_srg.types import Failure, Mode

# Environments whose policies act in cells.
ONE_SHOT = "drake_srg/GraspOneShot-v0"
_ENVIRONMENTS = {
    ONE_SHOT: GraspOneShotEnv,
    "drake_srg/Pick-v0": PickEnv,
    "drake_srg/KitchenPick-v0": PickEnv,
}


@dc.dataclass(frozen=True)
class CellPolicy:
    """What acts in a cell.

    Attributes:
        act: Returns the action for an observation.
        environment: Id of the environment that it is for.
        touch: Whether it sees the fingers' forces.
    """

    act: Act
    environment: str
    touch: bool = True


def run_cell_trial(
    policy: str,
    environment: str,
    tree: Mapping[str, Any],
    origin: str,
    seed: int,
    trial: int,
) -> TrialResult:
    """Run a trial of `drake-srg sweep` in which a policy takes the planner's place.

    `success` means that the object is up after the shake. Metrics of placing are left
    out.

    Args:
        policy: A policy's file or name, or a baseline.
        environment: Id of the environment that a baseline is for.
        tree: The scenario, from `load_tree`.
        origin: Its name or path.
        seed: Of trial 0.
        trial: Number of the trial, from 0.
    """
    actor = cell_policy(policy, environment, seed + trial)
    simulate = functools.partial(_simulate, actor)
    return run_trial(tree, origin, seed, trial, simulate=simulate)


def cell_policy(policy: str, environment: str, seed: int) -> CellPolicy:
    """Return what acts in a cell.

    Args:
        policy: A policy's file or name, or a baseline.
        environment: Id of the environment of a built-in policy; if it lacks that rule,
            the first one that has it counts. A trained policy names its own.
        seed: Of random actions.

    Raises:
        ScenarioError: If the policy cannot be read, or is of an environment whose
            policies do not act in cells.
    """
    loaded = None if policy in BUILT_IN else _policy(policy)
    if loaded is not None:
        environment = loaded.info.environment
    kind = _ENVIRONMENTS.get(environment)
    if kind is None:
        raise ScenarioError(
            f"{policy}: is for {environment}; "
            f"a scenario's cell takes policies for {', '.join(_ENVIRONMENTS)}"
        )
    if loaded is not None:
        check_sizes(policy, loaded, len(kind.observation_names), len(kind.action_names))
        return CellPolicy(loaded, environment, loaded.info.keywords.get("touch", True))
    if policy == RANDOM:
        return CellPolicy(random_policy(len(kind.action_names), seed), environment)
    # A rule that this environment lacks acts as in the first one that has it.
    names = [environment, *_ENVIRONMENTS]
    rules = {name: named_rule(name, policy) for name in names}
    return next(CellPolicy(rule, name) for name, rule in rules.items() if rule)


@functools.lru_cache(maxsize=1)
def _policy(name: str) -> Policy:
    return load_policy(name)


def check_driver(policy: str, scenario: Scenario, origin: str) -> None:
    """Check that a cell has the gripper for which a policy was trained.

    Raises:
        ScenarioError: If it has another one.
    """
    known = {tag[1:]: name for name, tag in DRIVER_TAGS.items()}
    own = type(scenario.gripper).__name__
    if own not in known:
        raise ScenarioError(
            f"{origin}: gripper: policies grasp with an SRG, got !{own} "
            f"(allowed: {', '.join(DRIVER_TAGS.values())})"
        )
    if policy in BUILT_IN:
        return
    trained = _policy(policy).info.keywords.get("driver", "plant")
    if known[own] != trained:
        raise ScenarioError(
            f"{policy}: was trained with driver={trained}, {origin} has !{own} "
            f"(allowed: --set gripper='{DRIVER_TAGS[trained]} {{}}')"
        )


def make_planner(policy: CellPolicy, scenario: Scenario) -> System:
    """Make the planner of a cell that acts by a policy.

    Args:
        policy: The policy.
        scenario: The cell's.

    Raises:
        ScenarioError: If the hand does not point down at home or does not reach the
            region, or the localizer does not know the picked object as a single
            cylinder or box.
    """
    assert scenario.arm is not None
    home = scenario.arm.home
    with scenario_errors():
        mover = MakeMover(MakeModelsPlant(scenario), np.array(home))
    name = scenario.task.pick
    shape = known_shape(name, scenario.objects[name])
    if shape is None:
        raise ScenarioError(
            f"objects.{name}: policies grasp single cylinders and boxes that the "
            "localizer knows"
        )
    table = scenario.table.height
    if policy.environment == ONE_SHOT:
        return GraspPlanner(policy.act, mover, home, name, shape, table)
    workspace = Workspace.of(scenario)
    joints_at(mover, np.array(home), workspace.start)  # checks that it is in reach
    return PolicyPlanner(
        policy.act,
        mover,
        home,
        name,
        shape,
        table,
        workspace=workspace,
        touch=policy.touch,
    )


def _simulate(policy: CellPolicy, scenario: Scenario, **options: Any) -> Result:
    """Run a cell with a policy; the arguments are those of `Simulate`."""
    result = Simulate(
        scenario, make_planner=functools.partial(make_planner, policy), **options
    )
    failure: str | None = result.metrics.failure
    success = False
    if result.status.mode is Mode.DONE:
        success = is_held(scenario, result)
        failure = None if success else Failure.NO_GRASP.value
    metrics = dc.replace(
        result.metrics,
        success=success,
        failure=failure,
        placement_error_m=None,
        placement_tilt_rad=None,
    )
    return dc.replace(result, metrics=metrics)


def is_held(scenario: Scenario, result: Result) -> bool:
    """Return whether the picked object was up at the end of a run, as in `HandTask`."""
    name = scenario.task.pick
    shape = simple_shape(name, scenario.objects[name])
    X_WO = row_to_pose(result.log[pose_key(name)][-1])
    if shape is None:
        return False
    down = -X_WO.rotation().matrix()[2]
    height = X_WO.translation()[2] - shape.half_extent(down) - scenario.table.height
    return bool(height >= 0.5 * LIFTED)
