"""Helpers of the tests: fix inputs, evaluate ports, fire one event, skip."""

import importlib.util
import os
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st
from pydrake.geometry import ColorRenderCamera, DepthRenderCamera, RenderCameraCore

from drake_srg.common.exceptions import ScenarioError


def fix(system, context, **inputs):
    """Fix input ports by name, vector and abstract ones alike."""
    for name, value in inputs.items():
        abstract = hasattr(value, "get_value")
        system.GetInputPort(name).FixValue(
            context, value if abstract else np.atleast_1d(value)
        )


def update(system, context, time=None):
    """Execute the system's periodic discrete update once, at `time` [s] if given."""
    if time is not None:
        context.SetTime(time)
    context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))


def read(system, context, name):
    """Return the value of an output port; vectors are copied."""
    value = system.GetOutputPort(name).Eval(context)
    return value.copy() if isinstance(value, np.ndarray) else value


def port_table(system):
    """Return (inputs, outputs): name to size, or to None for abstract ports."""

    def size(port):
        return port.size() if port.get_data_type().name == "kVectorValued" else None

    ins = map(system.get_input_port, range(system.num_input_ports()))
    outs = map(system.get_output_port, range(system.num_output_ports()))
    return (
        {port.get_name(): size(port) for port in ins},
        {port.get_name(): size(port) for port in outs},
    )


def break_camera(sensor, context):
    """Make it an error to render an image of an RgbdSensor in a context."""
    depth = sensor.GetDepthRenderCamera(context)
    core = depth.core()
    broken = RenderCameraCore(
        "broken",  # a renderer that does not exist
        core.intrinsics(),
        core.clipping(),
        core.sensor_pose_in_camera_body(),
    )
    sensor.SetColorRenderCamera(context, ColorRenderCamera(broken, False))
    sensor.SetDepthRenderCamera(context, DepthRenderCamera(broken, depth.depth_range()))


NO_DDS = "cyclonedds has no wheels for Python 3.14"
LACKS_DDS = sys.version_info >= (3, 14) and not importlib.util.find_spec("cyclonedds")
NEEDS_DDS = pytest.mark.skipif(LACKS_DDS, reason=NO_DDS)


def needs_debian(*programs):
    """Skip the test if a program, or a file given by its absolute path, is missing.

    With DRAKE_SRG_REQUIRE_PEERS in the environment, the test fails instead.
    """
    missing = [p for p in programs if not (shutil.which(p) or Path(p).is_file())]
    if missing:
        _skip_or_fail(f"{', '.join(missing)} missing: sh tools/install_test_peers.sh")


def needs_module(name):
    """Import a module; skip or fail like `needs_debian` if it is missing."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        _skip_or_fail(f"{name} cannot be imported: {error}")


# Prefix for the command of a process that is to receive SIGINT. A process that a shell
# starts in the background ignores it, and so do all of its children.
HEEDING_CTRL_C = ["env", "--default-signal=INT"]


def needs_pty():
    """Skip or fail like `needs_debian` without pseudo terminals, as in a chroot."""
    try:
        ends = os.openpty()
    except OSError as error:
        _skip_or_fail(f"no pseudo terminals here: {error}")
    else:
        for end in ends:
            os.close(end)


def _skip_or_fail(message):
    if "DRAKE_SRG_REQUIRE_PEERS" in os.environ:
        pytest.fail(message)
    pytest.skip(message)


_STRANGE = (b"nan", b"-1", b"1e999", b"", b"99999999999", b"\0", b"\xff\xfe", b"{}")


@st.composite
def damaged(draw, content):
    """Draw bytes that differ from a file's by one to three faults."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(content)))
        end = min(len(content), at + draw(st.sampled_from([0, 1, 4, 60])))
        numbers = list(re.finditer(rb"-?\d+(\.\d+)?", content))
        match draw(st.sampled_from(["cut", "change", "insert", "repeat", "number"])):
            case "cut":
                content = content[:at]
            case "change":
                new = draw(st.binary(min_size=end - at, max_size=end - at))
                content = content[:at] + new + content[end:]
            case "insert":
                new = draw(st.sampled_from(_STRANGE))
                content = content[:at] + new + content[end:]
            case "repeat":
                content = content[:end] + content[at:]
            case "number" if numbers:
                found = draw(st.sampled_from(numbers))
                new = draw(st.sampled_from(_STRANGE))
                content = content[: found.start()] + new + content[found.end() :]
    return content


def check_reads_or_refuses(read, path, *others):
    """Check that reading a file works or fails in one line that names the file."""
    try:
        read(path)
    except ScenarioError as error:
        assert "\n" not in str(error)
        names = [file.name for file in (path, *others)]
        assert any(name in str(error) for name in names), error
