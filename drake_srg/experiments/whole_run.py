"""Runs of a cell that count only as a whole, many in one process."""

from __future__ import annotations

from typing import Any

from drake_srg.lifetime import free_diagrams
from drake_srg.scenario import Scenario
from drake_srg.simulation.simulate import STOPPED_BY_USER, Result, Simulate


def simulate_whole(scenario: Scenario, **options: Any) -> Result:
    """Simulate a cell as `Simulate` does, but let an interrupt end the experiment.

    Half a run is no result, and the next run must not begin. The cell is freed.

    Args:
        scenario: The scenario to simulate.
        options: Keyword arguments of `Simulate`.

    Raises:
        KeyboardInterrupt: If the run was interrupted.
    """
    result = Simulate(scenario, **options)
    free_diagrams()
    if result.status.message == STOPPED_BY_USER:
        raise KeyboardInterrupt
    return result
