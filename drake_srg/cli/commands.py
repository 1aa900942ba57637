"""The commands run, demo, replay, list, diagram, bench and export.

Slow imports are inside functions, so that `drake-srg --help` stays fast.
"""

from __future__ import annotations

import argparse
import dataclasses as dc
import itertools
import json
import re
import shutil
import subprocess
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli.command import (
    BAD_INPUT,
    CELL,
    INTERRUPTED,
    OPEN,
    SCENARIO,
    SUCCESS,
    TASK_FAILED,
    argument,
    command,
    flag,
    load,
    name_of,
    one_of,
    scenario_arguments,
    stop_on_signals,
    tell,
    warn,
    writing,
)
from drake_srg.cli.objects import list_objects
from drake_srg.cli.results import REPLACE, RUN, folder, results_folder
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.simulation.simulate import Result


def run_hardware(options: argparse.Namespace) -> int:
    """Do a scenario's task on a robot; print the result and return the exit code.

    Raises:
        ScenarioError: If the input is bad, or the robot cannot be reached.
    """
    # Imported under the signal handlers, so that a signal ends the command cleanly.
    with stop_on_signals() as stop:
        from drake_srg.robot.drive.config import load_hardware
        from drake_srg.robot.drive.run import run_on_hardware
        from drake_srg.robot.serve.connecting import own_terminal

        config = load_hardware(options.hardware)
        scenario = load(options)
        name = name_of(options)
        with results_folder(options, Path("out") / "hardware" / name, RUN) as out:
            result = run_on_hardware(
                scenario,
                config,
                name=name,
                out=out,
                record=not options.no_record,
                progress=options.console.progress,
                stop=stop,
                tell=warn,
                terminal=own_terminal(sys.stdin),
            )
    code = _tell(options, result, out)
    return INTERRUPTED if stop.is_set() else code


@command(
    "do a scenario's task in simulation or on hardware",
    "Exit code: 0 success, 1 the task failed, 2 bad input.",
    SCENARIO,
    CELL,
    folder("the results", "out/SCENARIO or out/hardware/SCENARIO"),
    flag("--no-record", "write only metrics.json and log.npz"),
    argument(
        "--hardware",
        type=Path,
        metavar="FILE",
        help="do the task on a robot, through the drivers of this file",
    ),
)
def run(options: argparse.Namespace) -> int:
    """Do a scenario's task, and print its metrics and the paths of its files."""
    from drake_srg.simulation import Simulate
    from drake_srg.station.cell import MakeCell, load_make_cell

    if options.hardware is not None:
        if options.cell:
            raise ScenarioError(f"--cell {options.cell}: cannot go with --hardware")
        return run_hardware(options)
    make_cell = load_make_cell(options.cell) if options.cell else MakeCell
    scenario = load(options)
    name = name_of(options)
    with results_folder(options, Path("out") / name, RUN) as out:
        result = Simulate(
            scenario,
            name=name,
            out=out,
            record=not options.no_record,
            make_cell=make_cell,
            progress=options.console.progress,
        )
    return _tell(options, result, out)


def _tell(options: argparse.Namespace, result: Result, out: Path) -> int:
    """Print a result and the paths of its files; return the exit code."""
    from drake_srg.simulation.simulate import STOPPED_BY_USER

    metrics, say = result.metrics, options.console.say
    done = metrics.success if metrics.claimed is None else metrics.claimed
    say(metrics.table())
    if result.status.message and not done:
        say("", result.status.message)
    say("")
    for path in ("metrics.json", *filter(None, metrics.artifacts.values())):
        say(out / Path(path).name)
    options.console.answer(json.loads((out / "metrics.json").read_text("utf-8")))
    options.out = out
    if result.status.message == STOPPED_BY_USER:
        return INTERRUPTED
    return SUCCESS if done else TASK_FAILED


@command(
    "run the kitchen cell and record it",
    "The same as `drake-srg run kitchen`, with hints what to open and to try next. "
    "Exit code: 0 success, 1 the task failed.",
    folder("the results", "out/kitchen"),
    OPEN,
)
def demo(options: argparse.Namespace) -> int:
    """Run the kitchen cell, and name or open the replay."""
    options.scenario, options.seed, options.set = "kitchen", None, []
    options.no_record, options.hardware, options.cell = False, None, ""
    code = run(options)
    page = options.out / "replay.html"
    # The program as the user can type it, even if no environment is activated.
    typed = sys.argv[0] if Path(sys.argv[0]).name == "drake-srg" else "drake-srg"
    program = "drake-srg" if shutil.which("drake-srg") else typed
    options.console.say(
        "",
        f"Open {page} in a browser: the run in 3D, with all its signals.",
        f"No friction:   {program} run kitchen --set object.friction=0",
        f"All scenarios: {program} list",
    )
    if options.open:
        _open(page)
    return code


@command(
    "make the page that plays a recorded run",
    "The page is replay.html, which any browser opens. `drake-srg run` and recorded "
    "sweeps write it already. With several folders, it plays the runs side by side.",
    argument(
        "folders", type=Path, nargs="+", metavar="DIR", help="folder of a recorded run"
    ),
    argument(
        *("-o", "--out"),
        type=Path,
        metavar="FILE",
        help="with several folders: the page (default: compare.html in the first one)",
    ),
    OPEN,
)
def replay(options: argparse.Namespace) -> int:
    """Write the page of one recorded run again, or a page that compares several."""
    from drake_srg.recording.replay import write_comparison, write_page

    first: Path = options.folders[0]
    if len(options.folders) == 1 and options.out is not None:
        raise ScenarioError("-o: needs several folders (one has its DIR/replay.html)")
    with writing("DIR", first):
        if len(options.folders) == 1:
            page = write_page(first)
        else:
            page = options.out or first / "compare.html"
            write_comparison(options.folders, page)
    options.console.say(page)
    options.console.answer({"replay": page})
    if options.open:
        _open(page)
    return SUCCESS


def _open(page: Path) -> None:
    """Show a page in the default browser."""
    if not webbrowser.open(page.resolve().as_uri()):
        raise ScenarioError(f"--open: no browser found; open {page} yourself")


@command(
    "list the scenarios or the household objects",
    "",
    flag("--objects", "list the household objects instead"),
    argument(
        *("-o", "--out"),
        type=Path,
        metavar="DIR",
        help="with --objects: folder for pictures of the objects",
    ),
    REPLACE,
    name="list",
)
def list_all(options: argparse.Namespace) -> int:
    """Print the name and the first sentence of every scenario; or the objects."""
    if options.objects:
        return list_objects(options)
    if options.out is not None:
        raise ScenarioError("-o: needs --objects")
    found = scenario_titles()
    for name, title in found.items():
        options.console.say(f"{name:27} {title}")
    options.console.answer({"scenarios": found})
    return SUCCESS


def scenario_titles() -> dict[str, str]:
    """Return the first sentence of each scenario's file, by the scenario's name."""
    from drake_srg import scenario

    found = {}
    for name in scenario.list_scenarios():
        lines = (scenario.SCENARIOS / f"{name}.yaml").read_text().splitlines()
        comment = itertools.takewhile(lambda line: line.startswith("#"), lines)
        text = " ".join(line.removeprefix("#").strip() for line in comment)
        found[name] = re.split(r"(?<=\.) (?=[A-Z])", text)[0]
    return found


@command(
    "draw a scenario's block diagram",
    "",
    SCENARIO,
    argument(
        *("-o", "--out"),
        type=Path,
        required=True,
        metavar="FILE",
        help="the picture; ends in .svg, .png or .dot",
    ),
)
def diagram(options: argparse.Namespace) -> int:
    """Draw a scenario's systems and their connections."""
    from drake_srg.station import MakeCell

    output: Path = options.out
    kinds = (".svg", ".png", ".dot")
    if output.suffix not in kinds:
        raise ScenarioError(f"-o {output}: must end in one of {', '.join(kinds)}")
    scenario = load(options)
    with scenario_errors(name_of(options)):
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
    """Draw a graph with Graphviz, in the format of the file's suffix."""
    if shutil.which("dot") is None:
        raise ScenarioError(
            f"-o {output}: needs Graphviz (sudo apt-get install -y graphviz); only a "
            ".dot file does not"
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


@command(
    "measure how fast scenarios run, and where the time goes",
    "Exit code: 0 every scenario was measured, 2 at least one was not.",
    scenario_arguments(
        "*",
        "a name from `drake-srg list`, a .yaml file, or - for standard input "
        "(default: each scenario with a fast variant, and the variant)",
    ),
    argument(
        "--peers",
        type=Path,
        metavar="FILE",
        help="also measure robosuite, with this Python of an environment that has it "
        "(see docs/speed.md)",
    ),
)
def bench(options: argparse.Namespace) -> int:
    """Print how fast scenarios run, one column each."""
    from drake_srg.scenario import load_scenario
    from drake_srg.simulation.benchmark import (
        benchmark_table,
        import_times,
        measure_robosuite,
        run_benchmark,
        scenarios_with_fast_variant,
    )

    # Load all before the first one runs, so that a mistake shows at once.
    scenarios = {
        name: load_scenario(name, seed=options.seed, overrides=options.set)
        for name in options.scenario or scenarios_with_fast_variant()
    }
    peer = None if options.peers is None else measure_robosuite(options.peers)
    benchmarks, errors = {}, []
    with StatusLine(shown=options.console.progress) as line:
        for number, (name, scenario) in enumerate(scenarios.items()):
            stem = "stdin" if name == "-" else Path(name).stem
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
        tell(error)
        answer["error"] = error
    options.console.answer(answer)
    return BAD_INPUT if errors else SUCCESS


_PROGRAMS = {
    "urdf": "ROS, Drake and most other tools",
    "mjcf": "MuJoCo; the SRG's wires are tendons",
    "sdf": "Gazebo and Drake",
}


@command(
    "write a scenario's models as URDF, MJCF or SDF",
    "One file per model, and `scene` with all models in their places.",
    SCENARIO,
    one_of(
        *(
            argument(
                f"--{kind}",
                nargs="?",
                const="",
                metavar="DIR",
                help=f"write {kind.upper()}, for {programs}; DIR: as -o DIR",
            )
            for kind, programs in _PROGRAMS.items()
        ),
        required=True,
    ),
    folder("the files", "out/export/SCENARIO"),
)
def export(options: argparse.Namespace) -> int:
    """Write a scenario's models in a format, and print their paths."""
    from drake_srg.export import FORMATS, export_scenario
    from drake_srg.export.mjcf import moment_arm_error

    scenario = load(options)
    kind = next(k for k in _PROGRAMS if getattr(options, k) is not None)
    if where := getattr(options, kind):
        if options.out is not None:
            raise ScenarioError(f"-o {options.out}: must be absent with --{kind} DIR")
        options.out = Path(where)
    default = Path("out") / "export" / name_of(options)
    # With --replace, other models in the folder have the same suffix, but must stay.
    stem = "scene" if options.replace else "*"
    with results_folder(options, default, (stem + FORMATS[kind],)) as out:
        exported = export_scenario(scenario, kind, out)
    for each in exported:
        options.console.say(each.path)
    errors = [moment_arm_error(each.wires) for each in exported if each.wires]
    if errors:
        options.console.say(
            "",
            f"Moment arms of the tendons: within {max(errors):.2%} of the wires'.",
        )
    options.console.answer(
        {
            "models": {each.model.name: each.path for each in exported},
            "moment_arm_error": max(errors, default=None),
        }
    )
    return SUCCESS
