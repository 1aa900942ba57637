"""The parser of the command line: every command, and what it runs."""

import argparse
import importlib.metadata
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from drake_srg.cli import calibrate as cli_calibrate
from drake_srg.cli import commands
from drake_srg.cli import completion as cli_completion
from drake_srg.cli import experiment as cli_experiment
from drake_srg.cli import export as cli_export
from drake_srg.cli import hardware as cli_hardware
from drake_srg.cli import identify as cli_identify
from drake_srg.cli import learn as cli_learn
from drake_srg.cli import new as cli_new
from drake_srg.cli import objects as cli_objects
from drake_srg.cli import serve as cli_serve
from drake_srg.cli import sweep as cli_sweep
from drake_srg.cli import twin as cli_twin
from drake_srg.cli.output import Output, add_output_arguments
from drake_srg.cli.process import BAD_INPUT


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands; `options.run(options)` runs the chosen one."""
    parser = CommandParser(
        prog="drake-srg",
        description="Robot cells with the SAKE Robotics gripper, simulated with Drake.",
        epilog="`drake-srg COMMAND --help` describes a command and its options.",
    )
    parser.add_argument(
        "--version", action=_PrintVersion, nargs=0, help="print the version and exit"
    )
    subparsers = parser.add_subparsers(
        title="commands", required=True, metavar="COMMAND"
    )

    def add(
        name: str,
        run: Callable[[argparse.Namespace], int],
        summary: str,
        details: str = "",
        **options: Any,
    ) -> Any:
        """Add a command: the overview has the summary, its own help the details too."""
        description = f"{summary[0].upper()}{summary[1:]}. {details}".strip()
        command = subparsers.add_parser(
            name, help=summary, description=description, **options
        )
        command.set_defaults(run=run, command=name)
        add_output_arguments(command)
        return command

    run = add(
        "run",
        commands.run,
        "do a scenario's task in simulation or on hardware, and record it",
        "Exit code: 0 success, 1 the task failed, 2 bad input.",
    )
    _add_scenario(run)
    cli_hardware.add_run_arguments(run)

    demo = add(
        "demo",
        commands.demo,
        "run the kitchen cell and record it",
        "The same as `drake-srg run kitchen`. The last line is the path of the replay, "
        "which any browser opens. Exit code: 0 success, 1 the task failed.",
    )
    demo.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        default=Path("out/kitchen"),
        help="folder for the results (default: %(default)s)",
    )
    _add_open(demo)

    serve = add(
        "serve",
        cli_serve.serve,
        "run a scenario's station under outside command: ROS 1, ROS 2, a servo driver",
    )
    _add_scenario(serve)
    cli_serve.add_arguments(serve)

    cli_twin.add_command(add, _add_scenario)

    sweep = add(
        "sweep",
        cli_sweep.sweep,
        "run many trials of a scenario, one row each",
        "Trial k is `drake-srg run SCENARIO --seed S+k`. Exit code: 0 once all trials "
        "have run, whatever their outcome; 2 bad input; 130 interrupted.",
    )
    _add_scenario(sweep)
    cli_sweep.add_sweep_arguments(sweep)

    report = add(
        "report",
        cli_sweep.report,
        "turn a sweep into an HTML page",
        "The page shows how often trials succeed, why they fail and what that depends "
        "on.",
    )
    cli_sweep.add_report_arguments(report)

    dataset = add(
        "dataset",
        cli_sweep.dataset,
        "turn a sweep's recordings into a LeRobot data set",
        "Each recorded trial becomes an episode: `drake-srg sweep ... --record all`.",
    )
    cli_sweep.add_dataset_arguments(dataset)

    cli_learn.add_commands(add)

    replay = add(
        "replay",
        commands.replay,
        "make the page that plays a recorded run",
        "`drake-srg run` and recorded sweeps make it, too: replay.html, one file that "
        "any browser opens. With several folders, it plays the runs side by side.",
    )
    replay.add_argument(
        "folders", type=Path, nargs="+", metavar="DIR", help="folder of a recorded run"
    )
    replay.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE.html",
        help="page of several runs (default: compare.html in the first folder)",
    )
    replay.add_argument(
        "--rrd",
        action="store_true",
        help="also write replay.rrd for the Rerun viewer; needs the extra `rerun`",
    )
    _add_open(replay)

    list_ = add("list", commands.list_all, "list the scenarios or our objects")
    cli_objects.add_list_arguments(list_)

    import_ = add(
        "import",
        cli_objects.import_object,
        "make a model of an object from a mesh, a URDF or an SDF file",
        "It mends the file, cuts meshes into convex pieces, draws the object and drops "
        "it on a table. Exit code: 0 it rests there, 1 it does not, 2 bad "
        "input.",
    )
    cli_objects.add_import_arguments(import_)

    diagram = add("diagram", commands.diagram, "draw a scenario's block diagram")
    _add_scenario(diagram)
    diagram.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FILE",
        help="the picture; ends in .svg, .png or .dot",
    )

    bench = add(
        "bench",
        commands.bench,
        "measure how fast scenarios run, and where the time goes",
        "Exit code: 0 every scenario was measured, 2 at least one was not.",
    )
    _add_scenario(
        bench,
        nargs="*",
        help="a name from `drake-srg list` or a .yaml file (default: every scenario "
        "that has a fast variant, and the variant)",
    )
    bench.add_argument(
        "--peers",
        type=Path,
        metavar="PYTHON",
        help="measure robosuite, too: the Python of an environment that has it "
        "(see docs/speed.md)",
    )

    experiment = add(
        "experiment",
        cli_experiment.experiment,
        "compare models and drivers with published claims and theory",
        "Exit code: 0 every claim holds, 1 at least one does not, 2 bad input.",
        add_help=False,
    )
    cli_experiment.add_arguments(experiment)

    identify = add(
        "identify",
        cli_identify.identify,
        "fit a gripper's motor, friction and heat to what its servo showed",
        "It prints intervals, correlations and what the log leaves open, and writes a "
        "scenario.",
    )
    cli_identify.add_arguments(identify)
    _add_calibrate(add)
    _add_offers(add)
    add(
        "doctor",
        commands.doctor,
        "check what works on this machine, and print what installs the rest",
        "Exit code: 0 everything required works, 1 something required is missing.",
    )
    return parser


def _add_calibrate(add: Callable[..., Any]) -> None:
    calibrate = add(
        "calibrate",
        cli_calibrate.calibrate,
        "find a camera's intrinsics and pose by images of a ChArUco board",
        "In simulation, the arm shows the board to the camera. It prints standard "
        "deviations and writes the images, and a scenario with the result.",
    )
    calibrate.add_argument("what", choices=["camera"], help="what to calibrate")
    _add_scenario(calibrate)
    cli_calibrate.add_arguments(calibrate)


def _add_offers(add: Callable[..., Any]) -> None:
    """Add the commands that serve other programs, projects and shells."""
    export = add(
        "export",
        cli_export.export,
        "write a scenario's models as URDF, MJCF or SDF",
        "One file per model, and `scene` with all of them in their places.",
    )
    _add_scenario(export)
    cli_export.add_arguments(export)

    new = add(
        "new", cli_new.new, "start a project: scenario, localizer, test, notebook"
    )
    new.add_argument("name", metavar="NAME", help="of the project and its folder")

    completion = add(
        "completion",
        cli_completion.completion,
        "print a script that completes commands in a shell",
        cli_completion.USE,
    )
    completion.add_argument("shell", choices=cli_completion.SHELLS, help="which one")
    completion.set_defaults(make_parser=make_parser)


class CommandParser(argparse.ArgumentParser):
    """A parser that reports an error in one line, like every command."""

    json = False  # whether the command line asks for it

    def error(self, message: str) -> NoReturn:
        """Print what is wrong, and exit."""
        Output(self.json, quiet=False).complain(message)
        sys.exit(BAD_INPUT)


class _PrintVersion(argparse.Action):
    """Prints the version; looks it up only then, because that reads the disk."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"drake-srg {importlib.metadata.version('drake_srg')}")
        parser.exit()


def _add_scenario(
    parser: argparse.ArgumentParser,
    nargs: str | None = None,
    help: str = "a name from `drake-srg list` or a .yaml file",
) -> None:
    parser.add_argument("scenario", nargs=nargs, metavar="SCENARIO", help=help)
    parser.add_argument(
        "--seed", type=int, metavar="N", help="replaces the scenario's random_seed"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override an entry of the scenario (repeatable): a dotted key, a YAML "
        "value; `object.` stands for the picked object",
    )


def _add_open(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--open", action="store_true", help="show the page in the default browser"
    )
