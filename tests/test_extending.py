"""docs/extending.md: its code runs, its links resolve."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "extending.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
REPORT = """
import json
test_friction_used_is_tangential_over_normal_force()
print(json.dumps({
    "logs": [sorted(rig.log()), sorted(result.log)],
    "read": rig.measured("gripper.friction_used").tolist(),
    "friction_used": friction_used.tolist(),
    "success": result.metrics.success,
    "grip": result.log["gripper.closure_commanded"].max(),
}))
"""


@pytest.fixture(scope="module")
def ran():
    """What the page's blocks do, one after the other, in a program of their own."""
    program = "\n".join([*BLOCKS, REPORT])
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_the_sensor_is_a_port_of_the_station_and_in_the_log(ran):
    assert ran["read"] == ran["friction_used"][-1]
    assert all("gripper.friction_used" in log for log in ran["logs"])


def test_the_sensor_tells_what_the_tips_use_of_their_friction(ran):
    open_hand, holding = ran["friction_used"][0], ran["friction_used"][-1]
    assert open_hand == [0.0] * 4
    # The tips hold the can; rubber on the can slips at a friction of 0.8.
    assert all(0.0 < used < 0.8 for used in holding[2:])


def test_the_driver_sets_the_can_on_its_mark(ran):
    assert ran["success"]
    # Pads that lie flat on the can and a squeeze, 90 degrees + 0.4 rad, of 2.5 rad.
    assert ran["grip"] == pytest.approx((1.5708 + 0.4) / 2.5, abs=1e-3)


def test_links_resolve():
    links = re.findall(r"\]\((?!http)([^)#]*)", PAGE.read_text())
    assert links
    for link in links:
        assert (PAGE.parent / link).exists(), link
