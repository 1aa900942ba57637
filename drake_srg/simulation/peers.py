"""Measures other simulators, in Python environments of their own."""

import dataclasses as dc
import json
import subprocess
from pathlib import Path

from drake_srg.common.exceptions import ScenarioError
from drake_srg.simulation import robosuite_cycle


@dc.dataclass(frozen=True)
class Peer:
    """Times of robosuite: a cycle of PickPlaceCan with an IIWA, and control of Lift.

    Attributes:
        version: Version of robosuite.
        success: Whether the can is in its bin.
        simulated: Simulated time of the cycle [s].
        total: Its wall-clock time [s].
        lift_steps_per_s: Control steps of Lift per second of wall-clock time.
    """

    version: str
    success: bool
    simulated: float
    total: float
    lift_steps_per_s: float

    def lines(self) -> list[str]:
        """Return the figures as lines of text."""
        result = "success" if self.success else "failure"
        return [
            f"robosuite {self.version}, IIWA",
            f"PickPlaceCan          {result}, {self.simulated:.2f} s simulated, "
            f"{self.total:.2f} s wall clock",
            f"Lift                  {self.lift_steps_per_s:.0f} control steps per s",
        ]


def measure_robosuite(python: Path) -> Peer:
    """Measure robosuite, after a first cycle that loads everything.

    Args:
        python: The interpreter of an environment that has robosuite.

    Raises:
        ScenarioError: If it cannot run or has no robosuite.
    """
    # As text, because the folder of a script is where its imports are looked for first.
    script = Path(robosuite_cycle.__file__).read_text(encoding="utf-8")
    try:
        done = subprocess.run(
            [python, "-c", script], capture_output=True, text=True, check=True
        )
        return Peer(**json.loads(done.stdout.splitlines()[-1]))
    except subprocess.CalledProcessError as error:
        said = error.stderr.strip().splitlines() or [f"exit code {error.returncode}"]
        reason = said[-1]
    except (OSError, ValueError, TypeError, IndexError) as error:
        reason = str(error)
    raise ScenarioError(
        f"--peers {python}: must be the Python of an environment with robosuite "
        f"(see docs/speed.md): {reason}"
    )
