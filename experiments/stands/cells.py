"""Cells that are run as a whole, many in one process."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from typing import Any

import experiments.runner as ex
from drake_srg.lifetime import free_diagrams
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.simulation.simulate import STOPPED_BY_USER, Result, Simulate


def simulate_whole(scenario: Scenario, **options: Any) -> Result:
    """Simulate a cell as `Simulate` does, but let an interrupt end the experiment.

    Half a run is no result, and the next run must not begin. The cell is freed.

    Raises:
        KeyboardInterrupt: If the run was interrupted.
    """
    result = Simulate(scenario, **options)
    free_diagrams()
    if result.status.message == STOPPED_BY_USER:
        raise KeyboardInterrupt
    return result


def metrics_of(name: str, seed: int, overrides: Sequence[str] = ()) -> ex.Measures:
    """Run a scenario without recordings, and return its metrics."""
    scenario = load_scenario(name, seed=seed, overrides=overrides)
    return dc.asdict(simulate_whole(scenario, name=name).metrics)
