"""The client of a humanoid's hands, against two served hands in one process."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import NEEDS_DDS

from robot.serve.ros2.peers import free_domain

EXAMPLE = Path(__file__).parents[4] / "examples" / "dex1_client.py"


@NEEDS_DDS
@pytest.mark.slow
def test_the_example_closes_and_opens_both_hands():
    domain = str(free_domain())
    serve = [sys.executable, "-m", "drake_srg", "serve", "gripper_bench_fast"]
    options = ["--dex1", "left,right", "--domain", domain, "--no-record", "--rate", "0"]
    served = subprocess.Popen(
        [*serve, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    clients = []
    try:
        clients += [
            subprocess.Popen(
                [sys.executable, str(EXAMPLE), side, domain],
                stdout=subprocess.PIPE,
                text=True,
            )
            for side in ("left", "right")
        ]
        for client in clients:
            out, _ = client.communicate(timeout=120)
            assert client.returncode == 0
            closed, opened = out.splitlines()
            # An empty hand; the spool stops a little before 0 %.
            assert -1.0 < float(closed.partition("%")[0]) < 5.0, closed
            assert 47.0 < float(opened.partition("%")[0]) < 53.0, opened
    finally:
        for client in clients:
            client.kill()
        served.send_signal(signal.SIGINT)
        out, errors = served.communicate(timeout=60)
    assert served.returncode == 0, errors
    assert "Traceback" not in errors
    assert sum(line.startswith("served ") for line in out.splitlines()) == 2
