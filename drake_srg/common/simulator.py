"""Simulators by a scenario's configuration."""

from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import Context, Diagram, EventStatus

from drake_srg.common.drake_version import marks_fixed_steps


def MakeSimulator(diagram: Diagram, config: SimulatorConfig) -> Simulator:
    """Return a simulator of a diagram.

    In fixed steps, CENIC before Drake 1.58 does not mark as outdated what was computed
    from the state before a step: poses, distances and contacts would be one step old.
    So a monitor does.
    """
    simulator = Simulator(diagram)
    ApplySimulatorConfig(config, simulator)
    fixed = config.integration_scheme == "cenic" and not config.use_error_control
    if fixed and not marks_fixed_steps():
        simulator.set_monitor(_mark_outdated)
    return simulator


def _mark_outdated(root: Context) -> EventStatus:
    root.get_mutable_continuous_state_vector()
    return EventStatus.DidNothing()
