"""The commands run, demo, replay, list, diagram, bench and doctor.

Each takes the parsed command line, returns the exit code and raises a ScenarioError for
bad input. Imports that take time are inside, so that `drake-srg --help` comes at once.
"""

from __future__ import annotations

import argparse
import dataclasses as dc
import json
import shutil
import subprocess
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli import doctor as machine
from drake_srg.cli.hardware import run_hardware
from drake_srg.cli.objects import list_objects
from drake_srg.cli.process import (
    BAD_INPUT,
    SUCCESS,
    TASK_FAILED,
    end_on_sigterm,
    writing,
)
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.simulation.simulate import Result


def run(options: argparse.Namespace) -> int:
    """Do a scenario's task, and print its metrics and where the files are."""
    from drake_srg.scenario import load_scenario
    from drake_srg.simulation import Simulate

    if options.hardware is not None:
        return _tell(options, *run_hardware(options))
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
            progress=options.console.progress,
        )
    return _tell(options, result, out)


def _tell(options: argparse.Namespace, result: Result, out: Path) -> int:
    """Print a result and where its files are; return the exit code."""
    metrics, say = result.metrics, options.console.say
    done = metrics.success if metrics.claimed is None else metrics.claimed
    say(metrics.table())
    if result.status.message and not done:
        say("", result.status.message)
    say("")
    for path in ("metrics.json", *filter(None, metrics.artifacts.values())):
        say(out / Path(path).name)
    options.console.answer(json.loads((out / "metrics.json").read_text("utf-8")))
    return SUCCESS if done else TASK_FAILED


def demo(options: argparse.Namespace) -> int:
    """Run the kitchen cell, and name or open the replay."""
    options.scenario, options.seed, options.set = "kitchen", None, []
    options.no_record, options.hardware = False, None
    code = run(options)
    if options.open:
        _open(options.out / "replay.html")
    return code


def replay(options: argparse.Namespace) -> int:
    """Write the page of one recorded run again, or a page that compares several."""
    from drake_srg.replay import write_comparison, write_page, write_rrd

    first: Path = options.folders[0]
    if len(options.folders) == 1 and options.output is not None:
        raise ScenarioError("-o: needs several folders (one has DIR/replay.html)")
    if len(options.folders) > 1 and options.rrd:
        raise ScenarioError("--rrd: needs one folder")
    answer = {}
    with writing("DIR", first):
        if options.rrd:
            answer["rrd"] = write_rrd(first)
            options.console.say(answer["rrd"])
        if len(options.folders) == 1:
            page = write_page(first)
        else:
            page = options.output or first / "compare.html"
            write_comparison(options.folders, page)
    options.console.say(page)
    options.console.answer({**answer, "replay": page})
    if options.open:
        _open(page)
    return SUCCESS


def _open(page: Path) -> None:
    """Show a page in the default browser."""
    if not webbrowser.open(page.resolve().as_uri()):
        raise ScenarioError(f"--open: no browser found; open {page} yourself")


def list_all(options: argparse.Namespace) -> int:
    """Print the name and the first comment line of every scenario, or the objects."""
    from drake_srg import scenario

    if options.objects or options.pictures is not None:
        return list_objects(options)
    found = {}
    for name in scenario.list_scenarios():
        first = (scenario.SCENARIOS / f"{name}.yaml").read_text().splitlines()[0]
        found[name] = first.removeprefix("#").strip()
        options.console.say(f"{name:24} {found[name]}")
    options.console.answer({"scenarios": found})
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
    options.console.say(output)
    options.console.answer({"diagram": output})
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
        import_times,
        run_benchmark,
        scenarios_with_fast_variant,
    )
    from drake_srg.simulation.peers import measure_robosuite

    # All are loaded before the first one runs, so that a mistake shows at once.
    scenarios = {
        name: load_scenario(name, seed=options.seed, overrides=options.set)
        for name in options.scenario or scenarios_with_fast_variant()
    }
    peer = None if options.peers is None else measure_robosuite(options.peers)
    benchmarks, errors = {}, []
    with StatusLine(shown=options.console.progress) as line:
        for number, (name, scenario) in enumerate(scenarios.items()):
            stem = Path(name).stem
            line.count(number, len(scenarios), f"scenarios measured, now {stem}")
            try:
                benchmarks[stem] = run_benchmark(scenario, stem)
            except ScenarioError as failed:
                errors.append(str(failed))
        line.count(len(scenarios), len(scenarios), "scenarios done")
    error = "; ".join(errors)
    if not benchmarks:
        raise ScenarioError(error)
    imports = import_times()
    options.console.say(benchmark_table(benchmarks), "")
    for what, time in imports.items():
        options.console.say(f"{what:30}{time:.2f} s")
    answer = {
        "scenarios": {n: dc.asdict(b) for n, b in benchmarks.items()},
        "imports": imports,
    }
    if peer is not None:
        options.console.say("", *peer.lines())
        for name, benchmark in benchmarks.items():
            share = benchmark.total / peer.total
            options.console.say(f"{name} : PickPlaceCan  {share:.2f} of the wall clock")
        answer["robosuite"] = dc.asdict(peer)
    if errors:
        print(f"drake-srg: {error}", file=sys.stderr)
        answer["error"] = error
    options.console.answer(answer)
    return BAD_INPUT if errors else SUCCESS


def doctor(options: argparse.Namespace) -> int:
    """Print what works on this machine, and how to install the rest."""
    checks = machine.examine_machine()
    options.console.say(*checks)
    options.console.answer({"checks": [dc.asdict(check) for check in checks]})
    return SUCCESS if all(c.ok or c.optional for c in checks) else TASK_FAILED
