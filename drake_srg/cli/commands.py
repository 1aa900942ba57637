"""The commands run, demo, replay, list, diagram, bench, export and new.

Imports that take time are inside, so that `drake-srg --help` comes at once.
"""

from __future__ import annotations

import argparse
import dataclasses as dc
import json
import keyword
import re
import shutil
import subprocess
import sys
import tempfile
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli.command import (
    BAD_INPUT,
    OPEN,
    SCENARIO,
    SUCCESS,
    TASK_FAILED,
    a_scenario,
    argument,
    command,
    end_on_sigterm,
    flag,
    folder,
    load,
    one_of,
    stop_on_signals,
    writing,
)
from drake_srg.cli.objects import list_objects
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.simulation.simulate import Result


def run_hardware(options: argparse.Namespace) -> tuple[Result, Path]:
    """Do a scenario's task on a robot; return the result and the folder of its files.

    Raises:
        ScenarioError: If the input is bad, or the robot cannot be reached.
    """
    # Imported under the signal handlers, so that a signal ends the command cleanly.
    with stop_on_signals() as stop:
        from drake_srg.robot.drive import load_hardware, run_on_hardware
        from drake_srg.robot.serve.connecting import own_terminal

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


@command(
    "do a scenario's task in simulation or on hardware, and record it",
    "Exit code: 0 success, 1 the task failed, 2 bad input.",
    SCENARIO,
    folder(
        "folder for the results (default: out/SCENARIO; out/hardware/SCENARIO)",
    ),
    flag("--no-record", "write only metrics.json and log.npz"),
    argument(
        "--hardware",
        type=Path,
        metavar="FILE.yaml",
        help="do the task on a robot, through the drivers of this file",
    ),
)
def run(options: argparse.Namespace) -> int:
    """Do a scenario's task, and print its metrics and where the files are."""
    from drake_srg.simulation import Simulate

    if options.hardware is not None:
        return _tell(options, *run_hardware(options))
    scenario = load(options)
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


@command(
    "run the kitchen cell and record it",
    "The same as `drake-srg run kitchen`. The last line is the path of the replay, "
    "which any browser opens. Exit code: 0 success, 1 the task failed.",
    folder("folder for the results (default: %(default)s)", Path("out/kitchen")),
    OPEN,
)
def demo(options: argparse.Namespace) -> int:
    """Run the kitchen cell, and name or open the replay."""
    options.scenario, options.seed, options.set = "kitchen", None, []
    options.no_record, options.hardware = False, None
    code = run(options)
    if options.open:
        _open(options.out / "replay.html")
    return code


@command(
    "make the page that plays a recorded run",
    "`drake-srg run` and recorded sweeps make it, too: replay.html, one file that "
    "any browser opens. With several folders, it plays the runs side by side.",
    argument(
        "folders", type=Path, nargs="+", metavar="DIR", help="folder of a recorded run"
    ),
    argument(
        *("-o", "--output"),
        type=Path,
        metavar="FILE.html",
        help="page of several runs (default: compare.html in the first folder)",
    ),
    flag(
        "--rrd", "also write replay.rrd for the Rerun viewer; needs the extra `rerun`"
    ),
    OPEN,
)
def replay(options: argparse.Namespace) -> int:
    """Write the page of one recorded run again, or a page that compares several."""
    from drake_srg.recording.replay import write_comparison, write_page, write_rrd

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


@command(
    "list the scenarios or our objects",
    "",
    flag("--objects", "list our household objects instead"),
    argument(
        "--pictures",
        type=Path,
        metavar="DIR",
        help="with --objects: folder for a picture of each, and one of all",
    ),
    name="list",
)
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


@command(
    "draw a scenario's block diagram",
    "",
    SCENARIO,
    argument(
        *("-o", "--output"),
        type=Path,
        required=True,
        metavar="FILE",
        help="the picture; ends in .svg, .png or .dot",
    ),
)
def diagram(options: argparse.Namespace) -> int:
    """Draw a scenario's systems and their connections."""
    from drake_srg.station import MakeCell

    output: Path = options.output
    kinds = (".svg", ".png", ".dot")
    if output.suffix not in kinds:
        raise ScenarioError(f"-o {output}: must end in one of {', '.join(kinds)}")
    scenario = load(options)
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


@command(
    "measure how fast scenarios run, and where the time goes",
    "Exit code: 0 every scenario was measured, 2 at least one was not.",
    a_scenario(
        "*",
        "a name from `drake-srg list` or a .yaml file (default: every scenario "
        "that has a fast variant, and the variant)",
    ),
    argument(
        "--peers",
        type=Path,
        metavar="PYTHON",
        help="measure robosuite, too: the Python of an environment that has it "
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


_PROGRAMS = {
    "urdf": "ROS, Drake and most other tools",
    "mjcf": "MuJoCo; the SRG's wires are tendons",
    "sdf": "Gazebo and Drake",
}


@command(
    "write a scenario's models as URDF, MJCF or SDF",
    "One file per model, and `scene` with all of them in their places.",
    SCENARIO,
    one_of(
        *(
            argument(
                f"--{kind}",
                type=Path,
                metavar="DIR",
                help=f"folder for {kind.upper()} files: {programs}",
            )
            for kind, programs in _PROGRAMS.items()
        ),
        required=True,
    ),
)
def export(options: argparse.Namespace) -> int:
    """Write a scenario's models in a format, and print their paths."""
    from drake_srg.export import export_scenario
    from drake_srg.export.mjcf import moment_arm_error

    scenario = load(options)
    kind = next(k for k in _PROGRAMS if getattr(options, k) is not None)
    out: Path = getattr(options, kind)
    with writing(f"--{kind}", out):
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


_TEMPLATES = Path(__file__).with_name("project")
_PLACE = "@NAME@"


@command(
    "start a project: scenario, localizer, test, notebook",
    "",
    argument("name", metavar="NAME", help="of the project and its folder"),
)
def new(options: argparse.Namespace) -> int:
    """Write a project into a new folder, and print what to do with it."""
    with writing("NAME", Path(options.name)):
        here = Path.cwd()  # which may have been deleted
    folder = make_project(options.name, here)
    files = sorted(folder.iterdir())
    options.console.say(*(path.relative_to(here) for path in files))
    options.console.say("", f"Next: cd {options.name} && python -m pytest")
    options.console.answer({"project": folder, "files": [path.name for path in files]})
    return SUCCESS


def make_project(name: str, parent: Path) -> Path:
    """Write a project, and return its folder.

    Args:
        name: The project's, and its folder's.
        parent: Where the folder goes.

    Raises:
        ScenarioError: If the name is invalid or taken, or the folder cannot be written.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
        raise ScenarioError(
            f"NAME {name!r}: invalid (allowed: a-z, 0-9 and _, starting with a letter, "
            "no Python keyword)"
        )
    folder = parent / name
    if folder.exists():
        raise ScenarioError(f"NAME {name}: {folder} already exists")
    with (
        writing("NAME", folder),
        tempfile.TemporaryDirectory(prefix=f".{name}.", dir=parent) as hidden,
    ):
        draft = Path(hidden) / name
        draft.mkdir()
        for template in _TEMPLATES.glob("*.in"):
            text = template.read_text("utf-8").replace(_PLACE, name)
            (draft / template.stem).write_text(text, encoding="utf-8")
        shutil.move(draft, folder)
    return folder
