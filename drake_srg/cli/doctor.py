"""Checks that this machine has all that the package needs, and says what to install.

This module does not import Drake, so that the checks run even if Drake does not.
"""

from __future__ import annotations

import argparse
import dataclasses as dc
import importlib
import importlib.metadata
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from drake_srg.cli.command import SUCCESS, TASK_FAILED, command
from drake_srg.common.installing import (
    LIBRARIES,
    apt_install,
    library_fix,
    pip_install,
    this_package,
)

OLDEST_PYTHON = "3.11"
OLDEST_DRAKE = "1.51.1"

# Modules to import, and the packages that contain them.
_PACKAGES = {
    "cv2": "opencv-python-headless",
    "ruckig": "ruckig",
    "threadpoolctl": "threadpoolctl",
    "toppra": "toppra",
}
_ROSBAGS = {"rosbags.rosbag2": "rosbags"}
_PLOTS = {"matplotlib.figure": "matplotlib"}
_LEARN = ["torch", "stable-baselines3", "tensorboard", "onnx"]
_SWEEPS = {"jinja2": "jinja2", "joblib": "joblib", "pyarrow": "pyarrow"}
_IMPORT = {"coacd": "coacd", "scipy": "scipy", "trimesh": "trimesh"}
_ROS2 = {"cyclonedds.domain": "cyclonedds"}

_PATIENCE = 120.0  # longest time for a check in another interpreter [s]


@dc.dataclass(frozen=True)
class Check:
    """The result of one check.

    Attributes:
        name: Name of the checked feature.
        ok: Whether the feature works.
        detail: The result in words.
        fix: The command to run if the feature does not work.
        optional: Whether the package also runs without the feature.
    """

    name: str
    ok: bool
    detail: str
    fix: str = ""
    optional: bool = False

    def __str__(self) -> str:
        """The text that `drake-srg doctor` prints: a line, and a fix if needed."""
        word = "ok" if self.ok else "missing" if self.optional else "FAIL"
        line = f"{word:7} {self.name:10} {self.detail}"
        return line if self.ok else f"{line}\n{'':18} {self.fix}"


def examine_machine() -> list[Check]:
    """Check this machine; takes some seconds.

    It never raises. Checks that could crash the interpreter run in another one.

    Returns:
        One Check each for Python, Drake, the other packages, rendering, video, rosbags,
        plots, solvers and models, and optional ones for sweeps, training, Ray,
        ROS 2, meshes and Graphviz.
    """
    base = pip_install(*this_package())
    required: list[tuple[str, Callable[[], str], str]] = [
        ("python", _python, f"install Python {OLDEST_PYTHON} or newer"),
        ("drake", _drake, pip_install(f"drake>={OLDEST_DRAKE}")),
        ("packages", partial(_versions, _PACKAGES), base),
        (
            "rendering",
            partial(run_elsewhere, _RENDER),
            apt_install(*LIBRARIES.values()),
        ),
        ("video", _video, base),
        ("rosbags", partial(_versions, _ROSBAGS), base),
        ("plots", partial(_versions, _PLOTS), base),
        (
            "solvers",
            partial(run_elsewhere, _SOLVE),
            pip_install("--force-reinstall", "drake"),
        ),
        (
            "models",
            partial(run_elsewhere, _RESOLVE),
            pip_install("--force-reinstall", *this_package()),
        ),
    ]
    optional: list[tuple[str, Callable[[], str], str]] = [
        ("sweeps", partial(_versions, _SWEEPS), pip_install(*this_package("sweep"))),
        ("training", partial(_installed, _LEARN), pip_install(*this_package("learn"))),
        ("ray", partial(_installed, ["ray"]), pip_install(*this_package("ray"))),
        ("ros2", partial(_versions, _ROS2), pip_install(*this_package("ros2"))),
        ("import", partial(_versions, _IMPORT), pip_install(*this_package("import"))),
        ("graphviz", _graphviz, apt_install("graphviz")),
    ]
    return [
        *(check(*examination) for examination in required),
        *(dc.replace(check(*examination), optional=True) for examination in optional),
    ]


def check(name: str, examine: Callable[[], str], fix: str) -> Check:
    """Run a check. It fails if `examine` raises an exception.

    Args:
        name: Name of the checked feature.
        examine: Returns what was found, or raises.
        fix: The command to run if the check fails.
    """
    try:
        return Check(name, ok=True, detail=examine())
    except Exception as error:
        detail = " ".join(str(error).split()) or type(error).__name__
        return Check(name, ok=False, detail=detail, fix=library_fix(detail) or fix)


def _python() -> str:
    found = ".".join(map(str, sys.version_info[:3]))
    require_version("Python", found, OLDEST_PYTHON)
    return found


def _drake() -> str:
    found = importlib.metadata.version("drake")
    require_version("drake", found, OLDEST_DRAKE)
    run_elsewhere("import pydrake.all")
    return found


def _video() -> str:
    import av
    import numpy as np

    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "video.mp4")
        with av.open(path, "w") as container:
            stream = container.add_stream("libx264", rate=10)
            stream.width = stream.height = 64
            stream.pix_fmt = "yuv420p"
            for k in range(5):
                pixels = np.full((64, 64, 3), 40 * k, np.uint8)
                frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
        with av.open(path) as container:
            count = sum(1 for _ in container.decode(video=0))
    if count != 5:
        raise RuntimeError(f"H.264: 5 frames encoded, {count} decoded")
    return f"H.264 encodes and decodes, av {importlib.metadata.version('av')}"


def _installed(packages: Sequence[str]) -> str:
    # Do not import the packages: that takes seconds.
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in packages)


def _graphviz() -> str:
    found = shutil.which("dot")
    if found is None:
        raise RuntimeError("no `dot`; only `drake-srg diagram` needs it")
    return f"dot is {found}"


def _versions(packages: dict[str, str]) -> str:
    """Import modules, and return the versions of their packages."""
    found = []
    for module, package in packages.items():
        importlib.import_module(module)
        found.append(f"{package} {importlib.metadata.version(package)}")
    return ", ".join(found)


def require_version(name: str, found: str, oldest: str) -> None:
    """Check a version.

    Raises:
        RuntimeError: If `found` is older than `oldest`.
    """

    def numbers(version: str) -> list[int]:
        return [int(part) for part in version.split(".") if part.isdigit()]

    if numbers(found) < numbers(oldest):
        raise RuntimeError(f"{name} {found} is older than {oldest}")


def run_elsewhere(code: str, patience: float = _PATIENCE) -> str:
    """Run code in another interpreter, and return the last line that it prints.

    Args:
        code: The program.
        patience: Timeout [s].

    Raises:
        RuntimeError: If it crashes, raises or takes longer; the message says which.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            timeout=patience,
            check=False,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"timed out after {patience:g} s") from None
    if done.returncode < 0:
        raise RuntimeError(f"crashed by {signal.Signals(-done.returncode).name}")
    if done.returncode > 0:
        errors = [line for line in done.stderr.splitlines() if "Error" in line]
        raise RuntimeError(errors[-1] if errors else done.stderr[-200:])
    return (done.stdout.strip().splitlines() or [""])[-1]


_RENDER = """
import pydrake.geometry as geometry
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo, ImageRgba8U

engine = geometry.MakeRenderEngineVtk(geometry.RenderEngineVtkParams())
properties = geometry.PerceptionProperties()
properties.AddProperty("label", "id", geometry.RenderLabel(1))
properties.AddProperty("phong", "diffuse", geometry.Rgba(1, 0, 0))
engine.RegisterVisual(
    geometry.GeometryId.get_new_id(),
    geometry.Sphere(0.2),
    properties,
    RigidTransform([0, 0, 1]),
    needs_updates=False,
)
core = geometry.RenderCameraCore(
    "doctor",
    CameraInfo(64, 48, 0.8),
    geometry.ClippingRange(0.05, 10),
    RigidTransform(),
)
image = ImageRgba8U(64, 48)
engine.RenderColorImage(geometry.ColorRenderCamera(core), image)
red, green, *_ = image.at(32, 24)
if red < 100 or green > 50:
    raise RuntimeError(f"a red ball was rendered as {image.at(32, 24)}")
print("VTK renders without a display")
"""

_SOLVE = """
from pydrake.solvers import ClpSolver, IpoptSolver, MathematicalProgram
from pydrake.solvers import OsqpSolver, SnoptSolver

solvers = [SnoptSolver(), IpoptSolver(), ClpSolver(), OsqpSolver()]
for solver in solvers:
    name = solver.solver_id().name()
    if not solver.available():
        raise RuntimeError(f"{name} is not available")
    program = MathematicalProgram()
    [x] = program.NewContinuousVariables(1)
    program.AddBoundingBoxConstraint(1, 3, x)
    if name == "CLP":
        program.AddLinearCost(x)
    else:
        program.AddQuadraticCost(x * x)
    found = solver.Solve(program).GetSolution(x)
    if abs(found - 1) > 1e-3:
        raise RuntimeError(f"{name} returns {found}, the solution is 1")
print(", ".join(solver.solver_id().name() for solver in solvers))
"""

_RESOLVE = """
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from drake_srg.parsing import configure_parser

parser = Parser(MultibodyPlant(0.0))
configure_parser(parser)
print("package://drake_srg is " + parser.package_map().GetPath("drake_srg"))
"""


@command(
    "check what works on this machine, and how to install the rest",
    "Exit code: 0 everything required works, 1 something required is missing.",
)
def doctor(options: argparse.Namespace) -> int:
    """Print which features work on this machine, and how to install the rest."""
    checks = examine_machine()
    options.console.say(*checks)
    options.console.answer({"checks": [dc.asdict(check) for check in checks]})
    return SUCCESS if all(c.ok or c.optional for c in checks) else TASK_FAILED
