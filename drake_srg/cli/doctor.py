"""Whether this machine can run what the package offers, and what to install if not.

Nothing of Drake is imported here, so that the doctor can be asked where Drake fails.
"""

from __future__ import annotations

import dataclasses as dc
import importlib
import importlib.metadata
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from drake_srg.common.installing import pip_install, this_package

# Debian and Ubuntu packages of the libraries that Drake's wheel needs but does not
# carry; tools/install_system_libraries.sh has the same list.
IMPORT_PACKAGES = ("libglib2.0-0",)
RENDERING_PACKAGES = ("libegl1", "libgl1")
OLDEST_PYTHON = "3.10"
OLDEST_DRAKE = "1.51.1"

# Modules of the base install, and the packages that bring them.
_PACKAGES = {"cv2": "opencv-python-headless", "ruckig": "ruckig", "tqdm": "tqdm"}
_APT = "sudo apt-get update && sudo apt-get install -y --no-install-recommends "
_PATIENCE = 120.0  # s


@dc.dataclass(frozen=True)
class Check:
    """One finding: `detail` says what was found, `fix` what to run if it is not ok.

    What is `optional` may be missing on a machine that is well.
    """

    name: str
    ok: bool
    detail: str
    fix: str = ""
    optional: bool = False


def Checks() -> list[Check]:
    """Examine this machine; takes some seconds.

    Nothing here raises. What could crash the interpreter runs in one of its own.

    Returns:
        One Check each for Python, Drake, the other packages, rendering, video, rosbags,
        plots, solvers, models and, optional, ROS 2 and Graphviz.
    """
    recording = pip_install(*this_package("recording"))
    examinations: list[tuple[str, Callable[[], str], str]] = [
        ("python", _python, f"install Python {OLDEST_PYTHON} or newer"),
        ("drake", _drake, pip_install(f"drake>={OLDEST_DRAKE}")),
        ("packages", _packages, pip_install(*this_package())),
        ("rendering", _rendering, _APT + " ".join(RENDERING_PACKAGES)),
        ("video", _video, recording),
        ("rosbags", _rosbags, recording),
        ("plots", _plots, recording),
        ("solvers", _solvers, pip_install("--force-reinstall", "drake")),
        ("models", _models, pip_install("--force-reinstall", *this_package())),
    ]
    optional: list[tuple[str, Callable[[], str], str]] = [
        ("sweeps", _sweeps, pip_install(*this_package("sweep"))),
        ("ray", _ray, pip_install(*this_package("ray"))),
        ("ros2", _cyclonedds, pip_install(*this_package("ros2"))),
        ("graphviz", _graphviz, _APT + "graphviz"),
    ]
    return [
        *(_check(*examination) for examination in examinations),
        *(dc.replace(_check(*one), optional=True) for one in optional),
    ]


def _check(name: str, examine: Callable[[], str], fix: str) -> Check:
    try:
        return Check(name, ok=True, detail=examine())
    except Exception as error:
        detail = str(error).strip() or type(error).__name__
        if "libglib-2.0" in detail:  # nothing of Drake works without it
            fix = _APT + " ".join(IMPORT_PACKAGES)
        return Check(name, ok=False, detail=detail, fix=fix)


def _python() -> str:
    found = ".".join(map(str, sys.version_info[:3]))
    _at_least("Python", found, OLDEST_PYTHON)
    return found


def _drake() -> str:
    found = importlib.metadata.version("drake")
    _at_least("drake", found, OLDEST_DRAKE)
    _run_apart("import pydrake.all")
    return found


def _packages() -> str:
    found = []
    for name, package in _PACKAGES.items():
        importlib.import_module(name)
        found.append(f"{package} {importlib.metadata.version(package)}")
    return ", ".join(found)


def _rendering() -> str:
    return _run_apart(_RENDER)


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


def _rosbags() -> str:
    importlib.import_module("rosbags.rosbag2")
    return f"rosbags {importlib.metadata.version('rosbags')}"


def _sweeps() -> str:
    found = []
    for package in ("joblib", "pyarrow"):
        importlib.import_module(package)
        found.append(f"{package} {importlib.metadata.version(package)}")
    return ", ".join(found)


def _ray() -> str:
    # Found, not imported: that takes seconds.
    return f"ray {importlib.metadata.version('ray')}"


def _cyclonedds() -> str:
    importlib.import_module("cyclonedds.domain")
    return f"cyclonedds {importlib.metadata.version('cyclonedds')}"


def _plots() -> str:
    importlib.import_module("matplotlib.figure")
    return f"matplotlib {importlib.metadata.version('matplotlib')}"


def _solvers() -> str:
    return _run_apart(_SOLVE)


def _models() -> str:
    return _run_apart(_RESOLVE)


def _graphviz() -> str:
    found = shutil.which("dot")
    if found is None:
        raise RuntimeError("no `dot`; only `drake-srg diagram` needs it")
    return f"dot is {found}"


def _at_least(name: str, found: str, oldest: str) -> None:
    def numbers(version: str) -> list[int]:
        return [int(part) for part in version.split(".") if part.isdigit()]

    if numbers(found) < numbers(oldest):
        raise RuntimeError(f"{name} {found} is older than {oldest}")


def _run_apart(code: str) -> str:
    """Run code in another interpreter; what it prints last."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=_PATIENCE,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    if done.returncode < 0:
        raise RuntimeError(f"crashed by {signal.Signals(-done.returncode).name}")
    if done.returncode > 0:
        errors = [line for line in done.stderr.splitlines() if "Error" in line]
        raise RuntimeError(errors[-1] if errors else done.stderr[-200:])
    return (done.stdout.strip().splitlines() or [""])[-1]


_RENDER = """
import pydrake.geometry as geometry
from pydrake.common.value import Value
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
    raise RuntimeError(f"RenderError: a red ball came out as {image.at(32, 24)}")
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
        raise RuntimeError(f"{name} finds {found} where 1 is right")
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
