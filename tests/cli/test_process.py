import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from drake_srg.cli.process import writing
from drake_srg.common.exceptions import ScenarioError

OUT = Path("out")


def test_an_error_while_writing_names_the_option_and_the_path():
    with (
        pytest.raises(ScenarioError, match=r"^--out out: cannot be written: No space"),
        writing("--out", OUT),
    ):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_long_message_is_replaced_by_that_of_its_number():
    with (
        pytest.raises(
            ScenarioError, match=r"^-o out: cannot be written: No space[^.]*$"
        ),
        writing("-o", OUT),
    ):
        raise OSError(errno.ENOSPC, "Error writing bytes. Detail: [errno 28] Full.")


def test_an_error_without_a_number_keeps_its_message_in_one_line():
    with (
        pytest.raises(
            ScenarioError, match=r"^-o out: cannot be written: no codec here$"
        ),
        writing("-o", OUT),
    ):
        raise OSError("no codec\nhere")


@pytest.mark.parametrize(
    ("advice", "end"), [("try /tmp", "full; try /tmp"), ("", "full")]
)
def test_advice_follows_the_message(advice, end):
    with (
        pytest.raises(ScenarioError, match=f"written: {end}$"),
        writing("-o", OUT, lambda: advice),
    ):
        raise OSError("full")


def test_a_closed_pipe_is_no_problem_of_the_files():
    with pytest.raises(BrokenPipeError), writing("-o", OUT):
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))


def test_sigterm_ends_a_command_like_ctrl_c():
    code = (
        "import os, signal, time\n"
        "from drake_srg.cli.process import end_on_sigterm\n"
        "end_on_sigterm()\n"
        "try:\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    time.sleep(60)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "interrupted\n")


def test_a_signal_that_comes_while_the_event_is_looked_at_stops_too():
    code = (
        "import os, signal, threading\n"
        "from drake_srg.cli.process import stop_on_signals\n"
        "for _ in range(200):\n"
        "    with stop_on_signals() as stop:\n"
        "        arguments = os.getpid(), signal.SIGTERM\n"
        "        end = threading.Timer(0.001, os.kill, arguments)\n"
        "        end.start()\n"
        "        while not stop.wait(0.0):\n"
        "            pass\n"
        "        end.join()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], timeout=60.0, check=False)
    assert done.returncode == 0
