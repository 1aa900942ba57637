"""The commands run, replay, list, diagram, bench and doctor.

Each takes the parsed command line, returns the exit code and raises a ScenarioError for
bad input. Imports that take time are inside, so that `drake-srg --help` comes at once.
"""

import argparse
import shutil
import subprocess
import sys
import webbrowser
from pathlib import Path

from drake_srg.cli import doctor as machine
from drake_srg.cli.objects import list_objects
from drake_srg.cli.process import SUCCESS, TASK_FAILED, end_on_sigterm, writing
from drake_srg.common.exceptions import ScenarioError, scenario_errors


def run(options: argparse.Namespace) -> int:
    """Simulate a scenario, and print its metrics and where the files are."""
    from drake_srg.scenario import load_scenario
    from drake_srg.simulation import Simulate

    scenario = load_scenario(options.scenario, seed=options.seed, overrides=options.set)
    name = Path(options.scenario).stem
    out: Path = options.out or Path("out") / name
    end_on_sigterm()
    with writing("--out", out):
        result = Simulate(
            scenario,
            name=name,
            out=out,
            record=not options.no_record,
            progress=sys.stderr.isatty(),
        )
    metrics = result.metrics
    if options.json:
        print((out / "metrics.json").read_text(encoding="utf-8"), end="")
    else:
        print(metrics.table())
        if result.status.message and not metrics.success:
            print(f"\n{result.status.message}")
        print()
        for path in ("metrics.json", *filter(None, metrics.artifacts.values())):
            print(out / Path(path).name)
    return SUCCESS if metrics.success else TASK_FAILED


def replay(options: argparse.Namespace) -> int:
    """Write replay.html again, from the other files of a recorded run."""
    from drake_srg.replay import write_page

    with writing("DIR", options.folder):
        page = write_page(options.folder)
    print(page)
    if options.open and not webbrowser.open(page.resolve().as_uri()):
        raise ScenarioError(f"--open: no browser found; open {page} yourself")
    return SUCCESS


def list_all(options: argparse.Namespace) -> int:
    """Print the name and the first comment line of every scenario, or the objects."""
    from drake_srg import scenario

    if options.objects or options.pictures is not None:
        return list_objects(options)
    for name in scenario.list_scenarios():
        first = (scenario.SCENARIOS / f"{name}.yaml").read_text().splitlines()[0]
        print(f"{name:24} {first.removeprefix('#').strip()}")
    return SUCCESS


def diagram(options: argparse.Namespace) -> int:
    """Draw a scenario's systems and their connections."""
    from drake_srg.cell import MakeCell
    from drake_srg.scenario import load_scenario

    output: Path = options.output
    kinds = (".svg", ".png", ".dot")
    if output.suffix not in kinds:
        raise ScenarioError(f"-o {output}: must end in one of {', '.join(kinds)}")
    scenario = load_scenario(options.scenario, seed=options.seed, overrides=options.set)
    with scenario_errors(Path(options.scenario).stem):
        cell = MakeCell(scenario)
    dot = cell.GetGraphvizString()
    with writing("-o", output):
        if output.suffix == ".dot":
            output.write_text(dot)
        else:
            _draw(dot, output)
    print(output)
    return SUCCESS


def _draw(dot: str, output: Path) -> None:
    """Draw a graph with Graphviz, in the format that the file's name asks for."""
    if shutil.which("dot") is None:
        raise ScenarioError(
            f"-o {output}: needs Graphviz (sudo apt-get install -y graphviz); a .dot "
            "file does not"
        )
    try:
        subprocess.run(
            ["dot", f"-T{output.suffix[1:]}", "-o", str(output)],
            input=dot,
            text=True,
            check=True,
            capture_output=True,
        )
    except subprocess.CalledProcessError as error:
        reason = " ".join(error.stderr.split())
        raise ScenarioError(f"-o {output}: cannot be drawn: {reason}") from error


def bench(options: argparse.Namespace) -> int:
    """Print how fast scenarios run, one column each."""
    from drake_srg.scenario import load_scenario
    from drake_srg.simulation.benchmark import (
        benchmark_table,
        run_benchmark,
        scenarios_with_fast_variant,
    )

    # All are loaded before the first one runs, so that a mistake shows at once.
    scenarios = {
        name: load_scenario(name, seed=options.seed, overrides=options.set)
        for name in options.scenario or scenarios_with_fast_variant()
    }
    benchmarks = {
        Path(name).stem: run_benchmark(scenario, Path(name).stem)
        for name, scenario in scenarios.items()
    }
    print(benchmark_table(benchmarks))
    return SUCCESS


def doctor(options: argparse.Namespace) -> int:
    """Print what works on this machine, and how to install the rest."""
    checks = machine.examine_machine()
    for check in checks:
        print(check)
    return SUCCESS if all(c.ok or c.optional for c in checks) else TASK_FAILED
