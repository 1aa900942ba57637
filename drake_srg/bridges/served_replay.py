"""The replay of a served station."""

from __future__ import annotations

from pathlib import Path

from pydrake.systems.framework import Context, Diagram

from drake_srg.replay import write_page
from drake_srg.scenario import Scenario
from drake_srg.simulation.samples import Samples

LONGEST = 120.0  # A browser holds the whole replay [s].


class ServedReplay:
    """Samples the first two minutes of a served station for a replay.

    Args:
        name: The scenario's name.
        scenario: The scenario that is served; it must have an arm.
        root: The root diagram.
        station: The station in it.
    """

    def __init__(
        self, name: str, scenario: Scenario, root: Diagram, station: Diagram
    ) -> None:
        self._samples = Samples(name, scenario, root, station, replayed=True)
        self._period, self._next = scenario.recording.period, 0.0

    def sample(self, root: Context) -> None:
        """Add a sample if one is due."""
        time = root.get_time()
        if time < self._next - 1e-9 or time > LONGEST:
            return
        self._next = time + self._period
        self._samples.add(root)

    def write(self, out: Path) -> Path | None:
        """Write replay.html and the files that it is made of.

        Args:
            out: Folder to write to.

        Returns:
            The path of replay.html; None if nothing was sampled.

        Raises:
            OSError: If a file cannot be written.
        """
        return write_page(out) if self._samples.write(out) else None
