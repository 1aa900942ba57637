"""What is sampled during a run: its log and its replay."""

from pathlib import Path

from pydrake.systems.framework import Context, Diagram

from drake_srg.lifetime import my_context
from drake_srg.replay import ReplayRecorder
from drake_srg.scenario import Scenario
from drake_srg.simulation.recorders import write_samples
from drake_srg.simulation.run_log import RunLog


class Samples:
    """The samples of a run so far.

    Args:
        name: The scenario's.
        scenario: The scenario of the run.
        root: The root diagram.
        cell: The cell in it.
        replayed: Whether to sample the scene, too.

    Attributes:
        log: The log.
    """

    def __init__(
        self,
        name: str,
        scenario: Scenario,
        root: Diagram,
        cell: Diagram,
        replayed: bool,
    ) -> None:
        self._name, self._scenario, self._cell = name, scenario, cell
        self.log = RunLog(scenario, cell)
        self._replay = None
        if replayed:
            cameras = scenario.localizer.cameras
            self._replay = ReplayRecorder(root, cell, scenario.objects, cameras)

    def add(self, root: Context) -> None:
        """Add a sample, at the time of the root diagram's context."""
        self.log.sample(my_context(self._cell, root))
        if self._replay is not None:
            self._replay.sample(root)

    def write(self, out: Path | None) -> dict[str, str]:
        """Write the samples, if there are any; return paths by kind (see `FILES`).

        Raises:
            OSError: If a file cannot be written.
        """
        if out is None or not self.log:
            return {}
        log = self.log.arrays()
        return write_samples(self._name, log, self._scenario, out, self._replay)
