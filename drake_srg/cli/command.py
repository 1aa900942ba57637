"""Commands of the command line: arguments, exit codes, signals, output.

`command` decorates the function of a command; `make_parser` in `main.py` lists all
commands. It uses argparse, because with cyclopts, typer or tyro, `--help` takes 0.15 to
0.3 s longer, and errors take several lines.
"""

import argparse
import contextlib
import dataclasses as dc
import json
import os
import re
import shlex
import signal
import sys
import threading
import types
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, TypeAlias

from drake_srg.common.exceptions import ScenarioError, one_line

if TYPE_CHECKING:
    from drake_srg.scenario import Scenario

# Exit codes.
SUCCESS, TASK_FAILED, BAD_INPUT = 0, 1, 2
UNWRITABLE = 74  # standard output cannot be written: EX_IOERR of sysexits.h
INTERRUPTED = 130  # the shells' code for Ctrl-C


class OutputError(Exception):
    """Raised if standard output cannot be written; the message is the reason."""


# Time after which to try again to interrupt an import [s].
_AGAIN = 0.05


def end_on_signals() -> None:
    """Make Ctrl-C, SIGTERM and SIGHUP (a closed terminal) end the command.

    They raise a KeyboardInterrupt, but wait for the end of an import: there, Drake
    would turn it into an ImportError, and Python would print tracebacks. A second
    signal does not wait.
    """
    if threading.current_thread() is not threading.main_thread():  # Python's own limit
        return
    came = False

    def end(number: int, frame: types.FrameType | None) -> None:
        nonlocal came
        again, came = came and number != signal.SIGALRM, True
        while frame is not None and not again:
            if frame.f_code.co_filename.startswith("<frozen importlib"):
                signal.setitimer(signal.ITIMER_REAL, _AGAIN)
                return
            frame = frame.f_back
        raise KeyboardInterrupt

    for number in unignored(signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, end)
    signal.signal(signal.SIGALRM, end)


def unignored(*numbers: signal.Signals) -> list[signal.Signals]:
    """Return the signals to handle: `nohup` makes a process ignore SIGHUP."""
    return [n for n in numbers if signal.getsignal(n) != signal.SIG_IGN]


@contextlib.contextmanager
def writing(
    option: str, path: Path, advise: Callable[[], str] | None = None
) -> Iterator[None]:
    """Report an OSError as bad input that names an option and its path.

    Args:
        option: The option as on the command line, such as `--out`.
        path: The option's value.
        advise: Called after an OSError; returns a remedy, or "".

    Raises:
        ScenarioError: In place of an OSError.
    """
    try:
        yield
    except BrokenPipeError:  # the reader is gone; nothing to report
        raise
    except OSError as error:
        # PyArrow's own messages are several sentences long.
        reason = os.strerror(error.errno) if error.errno else one_line(error)
        message = f"{option} {path}: cannot be written: {reason}"
        advice = advise() if advise is not None else ""
        raise ScenarioError(f"{message}; {advice}" if advice else message) from error


@contextlib.contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C, SIGTERM and SIGHUP (a closed terminal) set.

    A second signal of the same kind has its usual effect.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():  # Python's own limit
        yield stop
        return
    # A handler may interrupt the main thread while that holds the event's lock. Setting
    # the event there would deadlock; SimpleQueue.put is reentrant.
    signals: SimpleQueue[bool] = SimpleQueue()

    def set_once() -> None:
        if signals.get():
            stop.set()

    setter = threading.Thread(target=set_once, daemon=True)
    setter.start()

    def end(number: int, _: object) -> None:
        signals.put(True)
        signal.signal(number, before[number])

    numbers = [signal.SIGINT, *unignored(signal.SIGTERM, signal.SIGHUP)]
    before: dict[int, Any] = {number: signal.getsignal(number) for number in numbers}
    try:
        for each in numbers:
            signal.signal(each, end)
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signals.put(False)
        setter.join()


# Pages of the documentation that explain commands, and entries of scenarios.
COMMAND_PAGES = {
    "calibrate": "docs/calibration.md",
    "serve": "docs/bridges.md",
    "sweep": "docs/sweeps.md",
    "report": "docs/sweeps.md",
    "dataset": "docs/dataset.md",
    "train": "docs/training.md",
    "evaluate": "docs/training.md",
    "experiment": "docs/experiments.md",
    "export": "docs/export.md",
    "grasps": "docs/grasp_labels.md",
    "identify": "docs/gripper.md",
    "import": "docs/importing.md",
    "import-arm": "docs/your_arm.md",
    "replay": "docs/replay.md",
    "twin": "docs/twin.md",
}
KEY_PAGES = {
    "camera_calibrations": "docs/calibration.md",
    "object": "docs/objects.md",
    "objects": "docs/objects.md",
    "sleeping": "docs/speed.md",
    "gripper": "docs/extending.md",
}

# Errors that need no page.
_PLAIN = (
    r"^stopped|cannot be (read|written)|already (exists|has)|is missing|"
    r"another process|`drake-srg doctor`"
)


class Output:
    """Standard output of a command.

    Args:
        json: Whether to print one JSON object and nothing else.
        quiet: Whether to print only errors, warnings and the JSON object.
        command: The command's name.

    Attributes:
        json: Whether to print one JSON object and nothing else.
        progress: Whether to show progress on standard error.
    """

    def __init__(self, json: bool, quiet: bool, command: str = ""):
        self.json, self.progress = json, not quiet
        self._words = not (json or quiet)
        self._command = command

    def say(self, *lines: object) -> None:
        """Print lines for people, unless --json or --quiet is given.

        Raises:
            OutputError: If standard output cannot be written.
        """
        if self._words:
            with printing():
                for line in lines:
                    print(line)

    def answer(self, values: Mapping[str, Any]) -> None:
        """Print the result as JSON with --json; values may be paths.

        Raises:
            OutputError: If standard output cannot be written.
        """
        if self.json:
            with printing():
                print(json.dumps(values, indent=2, default=str))

    def complain(self, message: str) -> None:
        """Print an error on standard error, and as JSON with --json."""
        page = page_about(message, self._command)
        tell(f"{message}{page and f' (see {page})'}")
        self.answer({"error": message, "page": page or None})


@contextlib.contextmanager
def printing() -> Iterator[None]:
    """Raise an OutputError if standard output cannot be written, as on a full disk."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(error.strerror or one_line(error)) from error


def tell(message: str) -> None:
    """Print a message on standard error; do nothing if it is closed or full."""
    with contextlib.suppress(OSError):
        print(f"drake-srg: {message}", file=sys.stderr, flush=True)


def warn(message: str) -> None:
    """Print a warning on standard error."""
    tell(f"warning: {message}")


def page_about(message: str, command: str) -> str:
    """Return the documentation page that explains an error, or an empty string."""
    if re.search(_PLAIN, message):
        return ""
    keys = "|".join(KEY_PAGES)
    if match := re.search(rf"(?:^|: |--set )({keys})[.=:]", message):
        return KEY_PAGES[match[1]]
    return COMMAND_PAGES.get(command, "")


# Adds arguments to a parser or a group.
Adds: TypeAlias = Callable[[Any], object]


@dc.dataclass(frozen=True)
class Command:
    """A command: the function that runs it, and its texts on the command line.

    Attributes:
        run: Takes the parsed command line and returns the exit code; raises a
            ScenarioError for bad input.
        name: The command's name.
        summary: Text for the overview, without capital and full stop.
        details: Text after the summary in the command's own help.
        adds: The command's arguments.
        own_help: Whether `adds` contains `--help`.
    """

    run: Callable[[argparse.Namespace], int]
    name: str
    summary: str
    details: str
    adds: tuple[Adds, ...]
    own_help: bool = False

    def __call__(self, options: argparse.Namespace) -> int:
        """Run the command."""
        return self.run(options)

    def add_to(self, subparsers: Any) -> None:
        """Add the command, and --json and --quiet, to a command line."""
        description = f"{sentence(self.summary)} {self.details}"
        parser = subparsers.add_parser(
            self.name,
            help=sentence(self.summary),
            description=description.strip(),
            add_help=False,
        )
        parser.set_defaults(run=self.run, command=self.name)
        helps = () if self.own_help else (HELP,)
        for add in (*helps, JSON, QUIET, *self.adds):
            add(parser)


def command(
    summary: str,
    details: str = "",
    *adds: Adds,
    name: str | None = None,
    own_help: bool = False,
) -> Callable[[Callable[[argparse.Namespace], int]], Command]:
    """Return a decorator that turns a function into a `Command`.

    Args:
        summary: Text for the overview, without capital and full stop.
        details: Text after the summary in the command's own help.
        adds: The command's arguments.
        name: Name of the command; None: the function's name.
        own_help: Whether `adds` contains `--help`.
    """
    return lambda run: Command(
        run, run.__name__ if name is None else name, summary, details, adds, own_help
    )


def argument(*names: str, help: str, **options: Any) -> Adds:
    """Return a function that adds an argument to a parser.

    Args:
        *names: As for argparse's `add_argument`.
        help: The help text, without capital and full stop.
        **options: As for `add_argument`.
    """
    text = sentence(help)
    return lambda parser: parser.add_argument(*names, help=text, **options)


def sentence(text: str) -> str:
    """Return a text with a capital and a full stop."""
    return f"{text[0].upper()}{text[1:]}."


def flag(name: str, help: str) -> Adds:
    """Return a function that adds an option without a value."""
    return argument(name, action="store_true", help=help)


def one_of(*adds: Adds, required: bool = False) -> Adds:
    """Return a function that adds mutually exclusive arguments."""

    def add(parser: argparse.ArgumentParser) -> None:
        group = parser.add_mutually_exclusive_group(required=required)
        for each in adds:
            each(group)

    return add


def all_of(*adds: Adds) -> Adds:
    """Return a function that adds several arguments."""

    def add(parser: argparse.ArgumentParser) -> None:
        for each in adds:
            each(parser)

    return add


def repeatable(name: str, metavar: str, help: str) -> Adds:
    """Return a function that adds an option that may be repeated."""
    return argument(name, action="append", default=[], metavar=metavar, help=help)


HELP = argument("-h", "--help", action="help", help="print this and exit")
# Options of every command. They may also stand before the command: without a default
# here, that value is kept.
JSON = argument(
    "--json",
    action="store_true",
    default=argparse.SUPPRESS,
    help="print one JSON object on standard output, also for an error",
)
QUIET = argument(
    *("-q", "--quiet"),
    action="store_true",
    default=argparse.SUPPRESS,
    help="print only errors, warnings and the object of --json",
)


def scenario_arguments(
    nargs: str | None = None,
    help: str = "a name from `drake-srg list`, a .yaml file, or - for standard input",
) -> Adds:
    """Return a function that adds a scenario, its seed and its overrides."""
    return all_of(
        argument("scenario", nargs=nargs, metavar="SCENARIO", help=help),
        argument(
            "--seed",
            type=int,
            metavar="N",
            help="a number that replaces the scenario's random_seed",
        ),
        repeatable(
            "--set",
            "KEY=VALUE",
            "override an entry of the scenario (repeatable): a dotted key, a YAML "
            "value; `object.` stands for the picked object",
        ),
    )


SCENARIO = scenario_arguments()
CELL = argument(
    "--cell",
    default="",
    metavar="MODULE:FUNCTION",
    help="your function that builds the cell from the scenario, as in a project of "
    "`drake-srg new`",
)


def load(options: argparse.Namespace) -> "Scenario":
    """Return the scenario that the options name; imports Drake."""
    from drake_srg.scenario import load_scenario

    return load_scenario(options.scenario, seed=options.seed, overrides=options.set)


def name_of(options: argparse.Namespace) -> str:
    """Return the name of a command's scenario, for its files and messages."""
    name: str = options.scenario
    return "stdin" if name == "-" else Path(name).stem


def resuming(options: argparse.Namespace, out: Path) -> str:
    """Return the command line that resumes an interrupted command."""
    words = [w for w in options.typed if w not in ("--resume", "--replace")]
    where = [] if options.out is not None else ["--out", str(out)]
    return shlex.join(["drake-srg", *words, *where, "--resume"])


OPEN = flag("--open", "show the page in the default browser")


def _domain(text: str) -> int:
    """Parse a ROS 2 domain. From 233 on, DDS would need ports above 65535."""
    if not (text.isdecimal() and int(text) <= 232):
        raise argparse.ArgumentTypeError(f"must be 0 to 232, got {text}")
    return int(text)


def ros(ros1: str, ros2: str, peer: str) -> Adds:
    """Return a function that adds the options of a command that speaks ROS.

    Args:
        ros1: Help text of `--ros1`.
        ros2: Help text of `--ros2`.
        peer: Who connects to this machine's address, for the help text of `--host`.
    """
    return all_of(
        flag("--ros1", ros1),
        argument(
            "--master", metavar="URI", help="ROS 1 master (default: $ROS_MASTER_URI)"
        ),
        flag("--ros2", ros2),
        argument(
            "--domain",
            type=_domain,
            metavar="N",
            help="ROS 2 domain (default: $ROS_DOMAIN_ID)",
        ),
        argument(
            "--host",
            default="127.0.0.1",
            metavar="ADDRESS",
            help=f"this machine's address for {peer} (default: %(default)s)",
        ),
    )


def speaks_ros(options: argparse.Namespace) -> tuple[bool, bool]:
    """Return whether a command speaks ROS 1, and whether it speaks ROS 2."""
    return (
        options.ros1 or options.master is not None,
        options.ros2 or options.domain is not None,
    )
