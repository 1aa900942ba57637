"""The command `drake-srg sweep`, with real trials where they matter."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helpers import HEEDING_CTRL_C
from sweeps import stub

from drake_srg.cli import sweep as cli_sweep
from drake_srg.cli.main import main
from drake_srg.sweeps import sweep
from drake_srg.sweeps.rows import TIMING_COLUMNS, read_rows
from drake_srg.sweeps.sweep import SweepFolder

TESTS = Path(__file__).parents[1]
ROOT = TESTS.parent
ABSENT = ["--set", "object.present=false"]


def arguments(out, *options):
    return ["sweep", stub.SCENARIO, "--out", str(out), *ABSENT, *options]


@pytest.fixture
def stubbed(monkeypatch):
    """The command with trials that cost nothing, run in this process."""
    run_sweep = sweep.run_sweep

    def run(*args, **options):
        return run_sweep(*args, **{**options, "trial_function": stub.trial})

    monkeypatch.setattr(cli_sweep, "make_engine", lambda options: stub.StubEngine())
    monkeypatch.setattr(sweep, "run_sweep", run)
    monkeypatch.setattr(sweep, "check_scenario", stub.unchecked)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--trials", "0"], ["--trials 0", "at least 1"]),
        (["--trials", "-3"], ["--trials -3", "at least 1"]),
        (["--trials", "1.5"], ["--trials", "1.5"]),
        ([], ["--trials"]),
        (["--trials", "2", "--jobs", "0"], ["--jobs 0", "at least 1"]),
        (["--trials", "2", "--record", "some"], ["some", "none", "failures", "all"]),
        (["--trials", "2", "--engine", "dask"], ["dask", "joblib", "ray"]),
        (["--trials", "2", "--address", "x"], ["--address", "--engine ray"]),
        (["--trials", "2", "--engine", "ray", "--jobs", "2"], ["--jobs", "joblib"]),
        (["--trials", "2", "--set", "directives=[]"], [stub.SCENARIO, "arm"]),
        (["--trials", "2", "--set", "objct.mass=1"], ["objct"]),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(options, words, tmp_path, capsys):
    try:
        code = main(arguments(tmp_path / "out", *options))
    except SystemExit as end:
        code = end.code
    assert code == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert len(output.err.splitlines()) == 1
    for word in words:
        assert word in output.err
    assert not (tmp_path / "out").exists()


def test_a_complete_sweep_prints_a_summary(stubbed, tmp_path, capsys):
    assert main(arguments(tmp_path, "--trials", "7", "--record", "failures")) == 0
    output = capsys.readouterr()
    assert output.err == ""
    lines = [" ".join(line.split()) for line in output.out.splitlines()]
    assert lines[:7] == [
        "success 5 of 7, 71.43%",
        "95 % interval (Wilson) 35.89% to 91.78%",
        "grasped and lifted 7 of 7",
        "failure: dropped 2",
        "wrongly reported done 1",
        "median to placement 6 s",
        "median cycle 8 s",
    ]
    assert lines[8:] == [str(tmp_path / "trials.parquet"), str(tmp_path / "recordings")]


def test_an_existing_sweep_is_kept_and_can_be_resumed(stubbed, tmp_path, capsys):
    assert main(arguments(tmp_path, "--trials", "2")) == 0
    capsys.readouterr()
    assert main(arguments(tmp_path, "--trials", "2")) == 2
    error = capsys.readouterr().err
    assert "--resume" in error
    assert len(error.splitlines()) == 1
    assert main(arguments(tmp_path, "--trials", "3", "--resume")) == 0
    assert read_rows(tmp_path).num_rows == 3


def test_a_full_disk_is_one_line_with_the_command_to_continue(
    stubbed, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(SweepFolder, "add", lambda *_: stub.no_space())
    assert main(arguments(tmp_path, "--trials", "2", "--seed", "3")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "cannot be written: No space left on device" in line
    assert "finished trials are kept" in line
    assert f" --out {tmp_path} {' '.join(ABSENT)} --trials 2" in line
    assert line.endswith("--seed 3 --resume")


def test_a_folder_that_cannot_be_made_has_nothing_to_continue(
    stubbed, tmp_path, capsys
):
    (tmp_path / "file").touch()
    out = tmp_path / "file" / "out"
    assert main(arguments(out, "--trials", "2")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"drake-srg: --out {out}: cannot be written: Not a directory"


def test_a_file_that_a_trial_cannot_read_is_not_blamed_on_out(
    stubbed, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(stub, "trial", lambda *_: Path("/missing.sdf").read_bytes())
    assert main(arguments(tmp_path, "--trials", "2")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert ": /missing.sdf: No such file or directory" in line
    assert "--out" not in line and "--resume" in line


# A sweep in a process of its own, whose trials take no time: `stub.slow` only waits.
STUBBED = """
import sys
from drake_srg.cli.main import main
from drake_srg.sweeps import sweep
from sweeps import stub
run_sweep = sweep.run_sweep
sweep.run_sweep = lambda *a, **o: run_sweep(*a, **{**o, "trial_function": stub.slow})
sweep.check_scenario = stub.unchecked
sys.exit(main())
"""


@pytest.mark.slow
def test_an_ended_sweep_continues_where_it_stopped(tmp_path, stubbed):
    command = arguments(tmp_path, "--trials", "8", "--jobs", "1", "--seed", "5")
    done = end_sweep(command, tmp_path, signal.SIGINT)
    command.append("--resume")
    for end in (signal.SIGTERM, signal.SIGKILL):
        before, done = done, end_sweep(command, tmp_path, end)
        assert done > before
    # The remaining trials run in this process, which is there already.
    assert main(command) == 0
    rows = read_rows(tmp_path).to_pylist()
    assert [row["trial"] for row in rows] == list(range(8))
    # As in a sweep that nothing ended.
    assert main(arguments(tmp_path / "whole", "--trials", "8", "--seed", "5")) == 0
    for row, whole in zip(rows, read_rows(tmp_path / "whole").to_pylist(), strict=True):
        for name, value in whole.items():
            assert name in TIMING_COLUMNS or row[name] == value, name


def end_sweep(command, out, end):
    """Run a sweep, end it by a signal after a trial; return how many trials it has."""
    trials = out / "trials"

    def finished():
        return set(trials.glob("[0-9]*.parquet")) if trials.exists() else set()

    before = finished()
    with subprocess.Popen(
        [*HEEDING_CTRL_C, sys.executable, "-c", STUBBED, *command],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": f"{TESTS}:{ROOT}"},
    ) as sweeping:
        while not finished() - before:
            assert sweeping.poll() is None
            time.sleep(0.02)
        if end == signal.SIGINT:
            os.killpg(sweeping.pid, end)  # as a terminal sends it, to all
        else:
            sweeping.send_signal(end)
        _, errors = sweeping.communicate(timeout=30)
    assert sweeping.returncode == (-end if end == signal.SIGKILL else 130)
    if end != signal.SIGKILL:
        (line,) = errors.splitlines()
        assert line.startswith("drake-srg: stopped; to continue: drake-srg sweep")
        assert line.endswith("--resume")
    done = read_rows(out).num_rows
    assert 1 <= done < 8
    return done
