"""Trials give the same rows wherever they run and however their workers end."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
import types
from concurrent.futures import Future
from pathlib import Path

import pytest
from helpers import HEEDING_CTRL_C, needs_module

from drake_srg.cli.main import main
from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps import engines, sweep
from drake_srg.sweeps.engines import THREADS, JoblibEngine
from drake_srg.sweeps.info import read_sweep
from drake_srg.sweeps.rows import TIMING_COLUMNS, read_rows
from drake_srg.sweeps.sweep import TRIES, SweepFolder

from . import stub

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("unchecked")]


@pytest.fixture(scope="module", autouse=True)
def no_thread_limits():
    """Unset what all tests inherit, so that only engines limit their workers."""
    with pytest.MonkeyPatch.context() as patch:
        for name in THREADS:
            patch.delenv(name, raising=False)
        yield


@pytest.fixture(scope="module")
def cluster():
    """Two nodes on this machine, with one core each."""
    ray = needs_module("ray")
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))  # of the stub
        cluster = Cluster(
            initialize_head=True,
            head_node_args={"num_cpus": 1, "include_dashboard": False},
        )
        cluster.add_node(num_cpus=1)
        yield cluster
        ray.shutdown()
        cluster.shutdown()


@pytest.fixture
def connected(cluster):
    """The cluster, with a connection that stays: workers are those of a connection."""
    import ray

    from drake_srg.sweeps.engines import RayEngine

    if not ray.is_initialized():
        RayEngine(cluster.address).__enter__()
    return cluster


@pytest.fixture(params=["1 job", "ray"])
def engine(request):
    if request.param != "ray":
        return JoblibEngine(int(request.param[0]))
    from drake_srg.sweeps.engines import RayEngine

    return RayEngine(request.getfixturevalue("connected").address)


def run(out, engine, monkeypatch, function=stub.trial, **tree):
    monkeypatch.setattr(sweep, "load_tree", lambda name, overrides: tree)
    return sweep.run_sweep(
        stub.SCENARIO, 8, out=out, engine=engine, trial_function=function
    )


def test_workers_have_one_thread_each(engine):
    with engine:
        for name, value in THREADS.items():
            assert engine.submit(stub.environment, name).result() == value


def test_a_trial_that_cannot_write_ends_the_sweep(tmp_path, monkeypatch):
    with pytest.raises(ScenarioError) as caught:
        run(tmp_path, JoblibEngine(1), monkeypatch, stub.no_space)
    said = "trial [01]: No space left on device; finished trials are kept, --resume .*"
    assert re.fullmatch(said, str(caught.value))


def test_a_cluster_with_another_version_is_rejected(connected, monkeypatch):
    here = {**engines.current_versions(), "drake": "0.0"}
    monkeypatch.setattr(engines, "current_versions", lambda: here)
    with (
        pytest.raises(ScenarioError, match=r"drake .* on .*, 0.0 here"),
        engines.RayEngine(connected.address),
    ):
        pass


# On Ray, starting a worker takes seconds, and no worker dies of another's trial. There,
# only one trial kills its workers.
@pytest.mark.parametrize(
    ("engine", "tries"),
    [("1 job", 2), ("2 jobs", TRIES), ("ray", 2)],
    indirect=["engine"],
)
def test_rows_are_the_same_on_every_engine_whatever_kills_its_worker(
    engine, tries, tmp_path, monkeypatch
):
    monkeypatch.setattr(sweep, "draw_scenario", stub.Drawn)
    monkeypatch.setattr(sweep, "TRIES", tries)
    note = tmp_path / "note"
    if engine.name == "ray":
        note.touch()
    rows = run(tmp_path / "a", engine, monkeypatch, stub.deadly, note=str(note))
    assert note.exists()  # on this machine, trial 5 has killed one
    workers = rows["worker"].to_pylist()
    rows, wanted = (
        table.drop_columns(TIMING_COLUMNS).to_pylist()
        for table in (rows, run(tmp_path / "b", stub.StubEngine(), monkeypatch))
    )
    dead = rows.pop(2)
    assert (dead["trial"], dead["failure"]) == (2, "error")
    assert f"its worker died {tries} times" in dead["message"]
    assert rows == [row for row in wanted if row["trial"] != 2]
    assert str(os.getpid()) not in workers


def test_a_node_with_other_code_runs_nothing():
    here = engines.current_versions()
    assert engines.call_on_node(here, abs, -1) == 1
    with pytest.raises(ScenarioError, match=r"drake_srg_sources .* on .*, other here"):
        engines.call_on_node({**here, "drake_srg_sources": "other"}, pytest.fail)


def test_a_sweep_survives_the_loss_of_a_node(tmp_path, monkeypatch, connected):
    from drake_srg.sweeps.engines import RayEngine

    node = connected.add_node(num_cpus=1)
    add = SweepFolder.add
    gone = []

    def remove_node(self, result):
        add(self, result)
        if not gone:
            gone.append(connected.remove_node(node, allow_graceful=False))

    monkeypatch.setattr(SweepFolder, "add", remove_node)
    rows = run(tmp_path, RayEngine(connected.address), monkeypatch, stub.slow)
    assert gone
    assert rows["trial"].to_pylist() == list(range(8))
    assert "error" not in rows["failure"].to_pylist()


def test_the_command_runs_real_trials_on_a_cluster(connected, tmp_path, capsys):
    options = ["--trials", "2", "--seed", "5", "--set", "object.present=false"]
    ray = ["--engine", "ray", "--address", connected.address]
    command = ["sweep", stub.SCENARIO, *options, "--out", str(tmp_path)]
    assert main([*command, *ray]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "failure: not_seen 2" in lines
    rows = read_rows(tmp_path)
    assert rows["seed"].to_pylist() == [5, 6]
    assert read_sweep(tmp_path).engine == "ray"
    workers = rows["worker"].to_pylist()
    assert not any(worker.endswith(f":{os.getpid()}") for worker in workers)


def test_an_address_without_a_cluster_is_named():
    needs_module("ray").shutdown()
    from drake_srg.sweeps.engines import RayEngine

    engine = RayEngine("127.0.0.1:9")
    with (
        pytest.raises(ScenarioError, match=r"--address 127.0.0.1:9: cannot connect"),
        engine,
    ):
        pass


def test_an_interrupt_while_a_trial_is_submitted_is_quiet(monkeypatch):
    errors = []
    monkeypatch.setattr(threading, "excepthook", errors.append)
    with pytest.raises(KeyboardInterrupt), JoblibEngine(2) as engine:
        engine.submit(os.getpid).result()
        engine.submit(time.sleep, 100)
        engine.submit(time.sleep, 100)
        raise KeyboardInterrupt
    assert not errors


class DeadPool:
    """An executor that accepts functions and never runs them."""

    def __init__(self, *_, **__):
        self.ends = []

    def submit(self, *_):
        return Future()

    def shutdown(self, **options):
        self.ends.append(options)


def test_a_function_that_is_never_accepted_does_not_hold_up_the_end(monkeypatch):
    pool, clock = DeadPool(), [0.0]
    loky = types.SimpleNamespace(ProcessPoolExecutor=lambda *_, **__: pool)
    monkeypatch.setattr(engines, "require_sweep", lambda module: loky)
    ticking = types.SimpleNamespace(
        monotonic=lambda: clock[0], sleep=lambda s: clock.append(clock.pop() + s)
    )
    monkeypatch.setattr(engines, "time", ticking)
    with pytest.raises(KeyboardInterrupt), JoblibEngine(1) as engine:
        engine.submit(os.getpid)
        raise KeyboardInterrupt
    assert pool.ends == [{"wait": True, "kill_workers": True}]
    assert 0.5 < clock[0] < 5.0  # it waits for a while, because a kill is not clean


def test_workers_end_when_their_sweep_is_killed():
    program = (
        "import os, time; from drake_srg.sweeps.engines import JoblibEngine\n"
        "with JoblibEngine(1) as engine:\n"
        "    print(engine.submit(os.getpid).result(), flush=True)\n"
        "    engine.submit(time.sleep, 100).result()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as sweeping:
        worker = int(sweeping.stdout.readline())
        sweeping.kill()
        for _ in range(100):
            if not is_running(worker):
                break
            time.sleep(0.1)
        assert not is_running(worker)


def is_running(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{process}/stat").read_text()
    return status.rpartition(")")[2].split()[0] != "Z"  # a zombie has ended


def test_ctrl_c_ends_workers_at_once():
    program = (
        "import os, time; from drake_srg.sweeps.engines import JoblibEngine\n"
        "with JoblibEngine(2) as engine:\n"
        "    engine.submit(os.getpid).result()\n"
        "    print(flush=True)\n"
        "    engine.submit(time.sleep, 100).result()"
    )
    with subprocess.Popen(
        [*HEEDING_CTRL_C, sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    ) as sweeping:
        sweeping.stdout.readline()
        os.killpg(sweeping.pid, signal.SIGINT)  # as a terminal sends it, to all
        _, errors = sweeping.communicate(timeout=60)
    # Loky's tracker, another process, may still warn of what killed workers left.
    assert "KeyboardInterrupt" in errors.splitlines()
    assert "LokyProcess" not in errors  # the workers are silent
