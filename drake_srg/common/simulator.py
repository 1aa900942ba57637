"""Simulators by a scenario's configuration."""

from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import Context, Diagram, EventStatus


def MakeSimulator(diagram: Diagram, config: SimulatorConfig) -> Simulator:
    """Return a simulator of a diagram.

    In fixed steps, CENIC does not mark as outdated what was computed from the state
    before a step: poses, distances and contacts would be one step old. So a monitor
    does.
    """
    simulator = Simulator(diagram)
    ApplySimulatorConfig(config, simulator)
    if config.integration_scheme == "cenic" and not config.use_error_control:
        simulator.set_monitor(_mark_outdated)
    return simulator


def _mark_outdated(root: Context) -> EventStatus:
    root.get_mutable_continuous_state_vector()
    return EventStatus.DidNothing()
