"""docs/extending.md: its programs run."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/extending.md").read_text("utf-8")
FOLDER = ROOT / "examples/extending"
REPORT = """
import json
import proportional_driver, slip_sensor

slip_sensor.test_friction_used_is_tangential_over_normal_force()
used = slip_sensor.main()
result = proportional_driver.main()
print(json.dumps({
    "logged": sorted(result.log),
    "friction_used": used.tolist(),
    "success": result.metrics.success,
    "grip": result.log["gripper.closure_commanded"].max(),
}))
"""


@pytest.fixture(scope="module")
def ran():
    """Return the results of the programs, run in a separate process."""
    done = subprocess.run(
        [sys.executable, "-c", REPORT],
        env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{FOLDER}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_the_page_shows_the_programs():
    shown = re.findall(r"{literalinclude} \.\./examples/extending/(\w+)\.py", PAGE)
    assert shown == ["slip_sensor", "proportional_driver"]


def test_a_driver_with_the_sensor_logs_it(ran):
    assert "gripper.friction_used" in ran["logged"]


def test_the_sensor_tells_what_the_tips_use_of_their_friction(ran):
    open_hand, holding = ran["friction_used"][0], ran["friction_used"][-1]
    assert open_hand == [0.0] * 4
    # The tips hold the can; rubber on the can slips at a friction of 0.8.
    assert all(0.0 < used < 0.8 for used in holding[2:])


def test_the_driver_sets_the_can_on_its_mark(ran):
    assert ran["success"]
    # Pads that lie flat on the can and a squeeze, 90 degrees + 0.4 rad, of 2.5 rad.
    assert ran["grip"] == pytest.approx((1.5708 + 0.4) / 2.5, abs=1e-3)
