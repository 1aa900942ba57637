"""Running a scenario's task on hardware."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli.command import load
from drake_srg.cli.process import stop_on_signals, writing

if TYPE_CHECKING:
    from drake_srg.simulation.simulate import Result


def run_hardware(options: argparse.Namespace) -> tuple[Result, Path]:
    """Do a scenario's task on a robot; return the result and the folder of its files.

    Raises:
        ScenarioError: If the input is bad, or the robot cannot be reached.
    """
    # Imported under the signal handlers, so that a signal ends the command cleanly.
    with stop_on_signals() as stop:
        from drake_srg.bridges.keyboard import own_terminal
        from drake_srg.hardware import load_hardware, run_on_hardware

        config = load_hardware(options.hardware)
        scenario = load(options)
        name = Path(options.scenario).stem
        out: Path = options.out or Path("out") / "hardware" / name
        with writing("--out", out):
            result = run_on_hardware(
                scenario,
                config,
                name=name,
                out=out,
                record=not options.no_record,
                progress=options.console.progress,
                stop=stop,
                tell=lambda text: print(f"drake-srg: warning: {text}", file=sys.stderr),
                terminal=own_terminal(sys.stdin),
            )
    return result, out
