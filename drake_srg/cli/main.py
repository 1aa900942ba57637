"""The command drake-srg."""

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from drake_srg.cli import doctor
from drake_srg.cli import serve as cli_serve
from drake_srg.cli import sweep as cli_sweep
from drake_srg.common.errors import ScenarioError, scenario_errors

# Exit codes.
SUCCESS, TASK_FAILED, BAD_INPUT = 0, 1, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    options = _parser().parse_args(arguments)
    try:
        code: int = options.run(options)
    except ScenarioError as error:
        return _complain(str(error))
    except ImportError as error:
        return _complain(f"{error}. `drake-srg doctor` says more.")
    except KeyboardInterrupt:
        return _complain("stopped")
    except BrokenPipeError:  # `| head` has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return SUCCESS
    return code


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line, as all others are."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong, and exit."""
        sys.exit(_complain(message))


class _ExperimentHelp(argparse.Action):
    """Shows the help of `experiment` and, after a NAME, what that one takes."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option: str | None = None,
    ) -> NoReturn:
        """Print and exit."""
        from drake_srg.experiments.registry import describe

        name = getattr(namespace, "name", None)
        try:
            print(describe(name) if name else parser.format_help())
        except ScenarioError as error:
            parser.error(str(error))
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="drake-srg",
        description="Robot cells with the SAKE Robotics gripper, simulated with Drake.",
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="simulate a scenario and record it")
    _add_scenario(run)
    run.add_argument(
        "--out", type=Path, metavar="DIR", help="results (default: out/SCENARIO)"
    )
    run.add_argument(
        "--no-record", action="store_true", help="only metrics.json and log.npz"
    )
    run.add_argument("--json", action="store_true", help="print metrics.json")
    run.set_defaults(run=_run)

    serve = commands.add_parser(
        "serve", help="run a scenario's station under the commands of ROS or a driver"
    )
    _add_scenario(serve)
    cli_serve.add_arguments(serve)
    serve.set_defaults(run=cli_serve.serve)

    sweep = commands.add_parser(
        "sweep", help="run many trials of a scenario, a row each, and count"
    )
    _add_scenario(sweep)
    cli_sweep.add_sweep_arguments(sweep)
    sweep.set_defaults(run=cli_sweep.sweep)

    report = commands.add_parser("report", help="make an HTML page of a sweep")
    cli_sweep.add_report_arguments(report)
    report.set_defaults(run=cli_sweep.report)

    dataset = commands.add_parser(
        "dataset", help="make a LeRobot data set of a sweep's recordings"
    )
    cli_sweep.add_dataset_arguments(dataset)
    dataset.set_defaults(run=cli_sweep.dataset)

    listing = commands.add_parser("list", help="list the scenarios")
    listing.set_defaults(run=_list)

    diagram = commands.add_parser("diagram", help="draw a scenario's systems")
    _add_scenario(diagram)
    diagram.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE.svg|.png|.dot"
    )
    diagram.set_defaults(run=_diagram)

    bench = commands.add_parser(
        "bench", help="measure the speed of a scenario, and where the time goes"
    )
    _add_scenario(
        bench,
        nargs="*",
        help="names of `drake-srg list`, or .yaml files (default: each scenario with "
        "a fast variant, and that)",
    )
    bench.set_defaults(run=_bench)

    experiment = commands.add_parser(
        "experiment",
        help="compare models and drivers with published claims and theory",
        add_help=False,
    )
    experiment.add_argument(
        *("-h", "--help"),
        action=_ExperimentHelp,
        nargs=0,
        help="show this and, after a NAME, the parameters of that experiment",
    )
    which = experiment.add_mutually_exclusive_group(required=True)
    which.add_argument("name", nargs="?", metavar="NAME", help="experiment to run")
    which.add_argument("--list", action="store_true", help="list the experiments")
    experiment.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="set a parameter of the experiment; YAML value",
    )
    experiment.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="result.json, tables and a figure (default: out/experiments/NAME)",
    )
    experiment.set_defaults(run=_experiment)

    check = commands.add_parser("doctor", help="say what works on this machine")
    check.set_defaults(run=_doctor)
    return parser


def _add_scenario(
    parser: argparse.ArgumentParser,
    nargs: str | None = None,
    help: str = "a name of `drake-srg list`, or a .yaml file",
) -> None:
    parser.add_argument("scenario", nargs=nargs, help=help)
    parser.add_argument(
        "--seed", type=int, help="replaces the scenario's random_seed", metavar="N"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace an entry: dotted key, YAML value; `object.` is the picked object",
    )


def _run(options: argparse.Namespace) -> int:
    from drake_srg.scenario import load_scenario
    from drake_srg.simulation import Simulate

    scenario = load_scenario(options.scenario, seed=options.seed, overrides=options.set)
    name = Path(options.scenario).stem
    out: Path = options.out or Path("out") / name
    cli_sweep.end_on_sigterm()
    try:
        result = Simulate(
            scenario,
            name=name,
            out=out,
            record=not options.no_record,
            progress=sys.stderr.isatty(),
        )
    except OSError as error:
        return _complain(f"--out {out}: cannot be written: {error.strerror or error}")
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


def _list(options: argparse.Namespace) -> int:
    from drake_srg.scenario import SCENARIOS, list_scenarios

    for name in list_scenarios():
        first = (SCENARIOS / f"{name}.yaml").read_text().splitlines()[0]
        print(f"{name:24} {first.removeprefix('#').strip()}")
    return SUCCESS


def _diagram(options: argparse.Namespace) -> int:
    from drake_srg.cell import MakeCell
    from drake_srg.scenario import load_scenario

    output: Path = options.output
    kinds = (".svg", ".png", ".dot")
    if output.suffix not in kinds:
        return _complain(f"-o {output}: must end in one of {', '.join(kinds)}")
    scenario = load_scenario(options.scenario, seed=options.seed, overrides=options.set)
    with scenario_errors(Path(options.scenario).stem):
        cell = MakeCell(scenario)
    dot = cell.GetGraphvizString()
    try:
        if output.suffix == ".dot":
            output.write_text(dot)
        elif shutil.which("dot") is None:
            return _complain(
                "drawing needs Graphviz: sudo apt-get install -y graphviz "
                "(a .dot file does not)"
            )
        else:
            subprocess.run(
                ["dot", f"-T{output.suffix[1:]}", "-o", str(output)],
                input=dot,
                text=True,
                check=True,
                capture_output=True,
            )
    except OSError as error:
        return _complain(f"-o {output}: cannot be written: {error.strerror or error}")
    except subprocess.CalledProcessError as error:
        return _complain(f"-o {output}: cannot be drawn: {error.stderr.strip()}")
    print(output)
    return SUCCESS


def _bench(options: argparse.Namespace) -> int:
    from drake_srg.scenario import load_scenario
    from drake_srg.simulation.bench import bench_table, run_bench, scenarios_with_a_twin

    # All are loaded before the first one is run: a mistake shows at once.
    scenarios = {
        name: load_scenario(name, seed=options.seed, overrides=options.set)
        for name in options.scenario or scenarios_with_a_twin()
    }
    benches = {
        Path(name).stem: run_bench(scenario, Path(name).stem)
        for name, scenario in scenarios.items()
    }
    print(bench_table(benches))
    return SUCCESS


def _experiment(options: argparse.Namespace) -> int:
    from drake_srg.experiments.registry import (
        list_experiments,
        list_measurements,
        run_experiment,
    )

    if options.list:
        for name, description in list_experiments().items():
            print(f"{name:24} {description}")
        if measurements := list_measurements():
            print("\nFor maintainers, in a checkout only (tools/measure):")
        for name, description in measurements.items():
            print(f"{name:24} {description}")
        return SUCCESS
    out: Path = options.out or Path("out") / "experiments" / options.name
    cli_sweep.end_on_sigterm()
    try:
        result = run_experiment(
            options.name, out, overrides=options.set, progress=sys.stderr.isatty()
        )
    except OSError as error:
        return _complain(f"--out {out}: cannot be written: {error.strerror or error}")
    print(result.table())
    print()
    for path in result.paths(options.name, out):
        print(path)
    return SUCCESS if result.passed else TASK_FAILED


def _doctor(options: argparse.Namespace) -> int:
    checks = doctor.Checks()
    for check in checks:
        word = "ok" if check.ok else "none" if check.optional else "FAIL"
        print(f"{word:4} {check.name:10} {check.detail}")
        if not check.ok:
            print(f"     {'':10} {check.fix}")
    return SUCCESS if all(c.ok or c.optional for c in checks) else TASK_FAILED


def _complain(message: str) -> int:
    print(f"drake-srg: {message}", file=sys.stderr)
    return BAD_INPUT
