import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from drake_srg.cli.command import COMMAND_PAGES, KEY_PAGES, Output, page_about, writing
from drake_srg.cli.main import main
from drake_srg.common.exceptions import ScenarioError

OUT = Path("out")


FULL = errno.ENOSPC, os.strerror(errno.ENOSPC)
LONG = errno.ENOSPC, "Error writing bytes. Detail: [errno 28] Full."


@pytest.mark.parametrize(
    ("error", "advice", "told"),
    [
        (OSError(*FULL), "", "No space left on device"),
        (OSError(*LONG), "", "No space left on device"),  # that of its number
        (OSError("no codec\nhere"), "", "no codec here"),
        (OSError("full"), "try /tmp", "full; try /tmp"),
    ],
)
def test_an_error_while_writing_names_the_option_and_the_path(error, advice, told):
    with (
        pytest.raises(ScenarioError, match=f"^--out out: cannot be written: {told}$"),
        writing("--out", OUT, lambda: advice),
    ):
        raise error


def test_a_closed_pipe_is_no_problem_of_the_files():
    with pytest.raises(BrokenPipeError), writing("-o", OUT):
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_end_a_command_like_ctrl_c(name):
    code = (
        "import os, signal, time\n"
        "from drake_srg.cli.command import end_on_signals\n"
        "end_on_signals()\n"
        "try:\n"
        f"    os.kill(os.getpid(), signal.{name})\n"
        "    time.sleep(60)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "interrupted\n")


def test_an_import_is_not_interrupted_but_what_follows_is(tmp_path):
    (tmp_path / "slow.py").write_text(
        "import os, signal, time\n"
        "os.kill(os.getpid(), signal.SIGINT)\n"
        "time.sleep(0.2)\n"
        "print('imported')\n"
    )
    code = (
        "import time\n"
        "from drake_srg.cli.command import end_on_signals\n"
        "end_on_signals()\n"
        "try:\n"
        "    import slow\n"
        "    time.sleep(60)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": f"{ROOT}:{tmp_path}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "imported\ninterrupted\n")


def test_nohup_lets_a_command_live():
    code = (
        "import os, signal\n"
        "from drake_srg.cli.command import end_on_signals, stop_on_signals\n"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"  # as `nohup` does
        "end_on_signals()\n"
        "with stop_on_signals() as stop:\n"
        "    os.kill(os.getpid(), signal.SIGHUP)\n"
        "    print(stop.wait(0.1))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "False\n")


def test_a_signal_that_comes_while_the_event_is_looked_at_stops_too():
    code = (
        "import os, signal, threading\n"
        "from drake_srg.cli.command import stop_on_signals\n"
        "numbers = [signal.SIGTERM, signal.SIGINT, signal.SIGHUP]\n"
        "for number in 70 * numbers:\n"
        "    with stop_on_signals() as stop:\n"
        "        arguments = os.getpid(), number\n"
        "        end = threading.Timer(0.001, os.kill, arguments)\n"
        "        end.start()\n"
        "        while not stop.wait(0.0):\n"
        "            pass\n"
        "        end.join()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], timeout=60.0, check=False)
    assert done.returncode == 0


ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("json_", "quiet", "printed"),
    [
        (False, False, "words\n"),
        (False, True, ""),
        (True, False, '{\n  "path": "a/b"\n}\n'),
        (True, True, '{\n  "path": "a/b"\n}\n'),
    ],
)
def test_words_are_for_people_and_json_for_scripts(json_, quiet, printed, capsys):
    output = Output(json_, quiet)
    output.say("words")
    output.answer({"path": Path("a/b")})
    assert capsys.readouterr().out == printed
    assert output.progress is not quiet


@pytest.mark.parametrize("page", sorted({*COMMAND_PAGES.values(), *KEY_PAGES.values()}))
def test_the_pages_are_there(page):
    assert (ROOT / page).is_file()


@pytest.mark.parametrize(
    ("message", "command", "page"),
    [
        ("kitchen: objects.can.mass: must be greater than 0", "run", "docs/objects.md"),
        ("--set object.mas=1: unknown", "run", "docs/objects.md"),
        ("kitchen: sleeping.after: must be positive", "sweep", "docs/speed.md"),
        ("--trials 0: must be at least 1", "sweep", "docs/sweeps.md"),
        ("--out x: cannot be written: No space left on device", "sweep", ""),
        ("stopped", "sweep", ""),
        ("unknown scenario 'kitchn'", "run", ""),
    ],
)
def test_errors_name_the_page_that_explains_them(message, command, page):
    assert page_about(message, command) == page


def test_an_error_is_a_line_and_for_scripts_an_object(tmp_path, capsys):
    folder = tmp_path / "nothing"
    assert main(["replay", str(folder), "--json", "--quiet"]) == 2
    output = capsys.readouterr()
    answer = json.loads(output.out)
    assert answer["page"] == "docs/replay.md"
    assert output.err == f"drake-srg: {answer['error']} (see docs/replay.md)\n"


@pytest.mark.parametrize("arguments", [["list", "--json"], ["experiment", "--list"]])
def test_lists_are_for_scripts_too(arguments, capsys):
    assert main([*arguments, "--json"]) == 0
    lists = json.loads(capsys.readouterr().out)
    assert all(isinstance(names, dict) for names in lists.values())


def test_a_bad_command_line_is_an_object_too(capsys):
    with pytest.raises(SystemExit):
        main(["run", "--json"])
    assert "SCENARIO" in json.loads(capsys.readouterr().out)["error"]
