from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from drake_srg.planning.motion.limits import InverseDynamics, MotionLimits
from drake_srg.planning.motion.time_parameterization import on_demand
from drake_srg.planning.motion.trajectories import grid_of, rounded_path
from experiments.speed import solve_with_drake

# Solvers stop at this relative error.
SOLVER = 1e-6
MIDDLE = np.array([0.0, 0.2, 0.0, -1.5, 0.0, 1.2, 0.0])  # of the iiwa [rad]

unit = st.floats(-1.0, 1.0)
share = st.floats(0.2, 1.0)


def toppra_parameterization(*arguments):
    """Call ours, imported only here: every worker collects, and toppra takes long."""
    from drake_srg.planning.motion import toppra_parameterization as module

    return module.toppra_parameterization(*arguments)


@st.composite
def motions(draw, count):
    """Draw points of a path, (count, 7), and factors on the limits."""
    values = draw(st.lists(unit, min_size=7 * count, max_size=7 * count))
    points = MIDDLE + 0.5 * np.array(values).reshape(count, 7)
    # Where a path stands still, no speed along it is too high.
    assume(np.min(np.linalg.norm(np.diff(points, axis=0), axis=1)) > 0.1)
    return points, [draw(share), draw(share), draw(st.floats(0.7, 1.0))]


@settings(max_examples=25)
@given(motions(5))
def test_toppra_keeps_all_limits(iiwa, motion):
    path, grid, limits = posed(iiwa, motion)
    progress = toppra_parameterization(iiwa, path, limits, grid)
    assert progress.start_time() == 0.0
    ends = [progress.value(t)[0, 0] for t in (0.0, progress.end_time())]
    np.testing.assert_allclose(ends, grid[[0, -1]], atol=1e-9)
    assert max(uses(iiwa, path, progress, grid, limits)) <= 1.0 + SOLVER


@settings(max_examples=25)
@given(motions(3))
def test_drake_takes_the_same_time(iiwa, motion):
    points, _ = motion
    first, second = np.diff(points, axis=0)
    if first @ second < 0.0:  # Drake finds no motion along some paths that turn back
        points[2] = points[1] - second
    path, grid, limits = posed(iiwa, motion)
    ours = toppra_parameterization(iiwa, path, limits, grid).end_time()
    drake = solve_with_drake(iiwa, path, limits, grid).end_time()
    assert ours == pytest.approx(drake, rel=0.05)


def posed(scene, motion):
    points, factors = motion
    path, _ = rounded_path(points, spans=8)
    grid = grid_of(path)
    limits = MotionLimits.of_plant(scene).scaled(*factors)
    dynamics = InverseDynamics(scene)
    for s in grid:
        dynamics.SetPosition(path.value(s)[:, 0])
        assume(np.all(np.abs(dynamics.holding()) < 0.95 * limits.torque))
    return path, grid, limits


def uses(scene, path, progress, grid, limits):
    """Yield the largest shares of the limits at the grid points."""
    dynamics = InverseDynamics(scene)
    first, second = path.MakeDerivative(1), path.MakeDerivative(2)
    # Speeds and times at grid points: between them, acceleration is constant.
    times = np.array(progress.get_segment_times())
    assert len(times) == len(grid)
    x = np.array([progress.EvalDerivative(t, 1)[0, 0] for t in times]) ** 2
    u = np.diff(x) / (2.0 * np.diff(grid))
    for i, s in enumerate(grid):
        q, dq, ddq = (f.value(s)[:, 0] for f in (path, first, second))
        dynamics.SetPosition(q)
        v = dq * np.sqrt(x[i])
        yield np.max(np.abs(v) / limits.velocity)
        for u_i in u[max(i - 1, 0) : i + 1]:
            a = dq * u_i + ddq * x[i]
            torque = dynamics.holding() + dynamics.moving(v, a)
            yield np.max(np.abs(a) / limits.acceleration)
            yield np.max(np.abs(torque) / limits.torque)


def test_an_arm_too_weak_to_hold_itself_cannot_move(pendulum):
    limits = MotionLimits.of_plant(pendulum).scaled(torque=0.6)  # 7.8 of 9.81 N m
    path, _ = rounded_path(np.array([[0.0, 0.0], [-0.2, 0.0]]), spans=8)
    assert toppra_parameterization(pendulum, path, limits, grid_of(path)) is None


def test_joints_without_limits_do_not_slow_the_others(pendulum):
    limits = MotionLimits.of_plant(pendulum)
    free = MotionLimits(
        np.array([2.0, np.inf]), np.array([10.0, np.inf]), np.full(2, np.inf)
    )
    path, _ = rounded_path(np.array([[0.0, 0.0], [0.8, 0.0]]), spans=8)
    grid = grid_of(path)
    fast = toppra_parameterization(pendulum, path, free, grid).end_time()
    # 0.8 rad at 2 rad/s and 10 rad/s^2, from rest to rest; the grid costs a little.
    assert fast == pytest.approx(0.8 / 2.0 + 2.0 / 10.0, rel=0.05)
    limited = toppra_parameterization(pendulum, path, limits, grid)
    assert limited.end_time() >= fast - 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "imported"), [("kitchen_fast", True), ("gripper_bench", False)]
)
def test_toppra_is_imported_while_the_cell_is_built(scenario, imported):
    code = f"""
import sys
from drake_srg import MakeCell, load_scenario
cell = MakeCell(load_scenario({scenario!r}))
print("toppra" in sys.modules)
assert "matplotlib.axes" not in sys.modules, "toppra only draws on request"
assert "scipy" not in sys.modules, "toppra only interpolates on request"
"""
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert run.stdout.split() == [str(imported)]


def test_a_module_on_demand_is_imported_when_it_is_used(tmp_path, monkeypatch):
    (tmp_path / "drawing_on_demand").mkdir()
    (tmp_path / "drawing_on_demand/pens.py").write_text("color = 'red'")
    (tmp_path / "user_on_demand.py").write_text("import drawing_on_demand.pens as pens")
    monkeypatch.syspath_prepend(tmp_path)
    names = ("drawing_on_demand", "drawing_on_demand.pens")
    with on_demand(*names):
        import user_on_demand
    assert not set(names) & set(sys.modules)
    assert user_on_demand.pens.color == "red"
    assert set(names) <= set(sys.modules)
    with on_demand(*names):  # loaded modules stay
        assert sys.modules[names[1]].color == "red"
    assert set(names) <= set(sys.modules)


def test_what_a_module_on_demand_holds_is_imported_when_it_is_used(
    tmp_path, monkeypatch
):
    (tmp_path / "curves_on_demand").mkdir()
    (tmp_path / "curves_on_demand/__init__.py").write_text(
        "class Line(list):\n    @classmethod\n    def of(cls, *x): return cls(x)"
    )
    (tmp_path / "taker_on_demand.py").write_text("from curves_on_demand import Line")
    monkeypatch.syspath_prepend(tmp_path)
    with on_demand("curves_on_demand"):
        import taker_on_demand
    assert "curves_on_demand" not in sys.modules
    line = taker_on_demand.Line([1, 2])
    assert line == taker_on_demand.Line.of(1, 2) == [1, 2]
    assert type(line) is sys.modules["curves_on_demand"].Line


@pytest.mark.slow
def test_toppra_still_finds_scipy_for_its_own_paths_and_solvers():
    code = """
import sys
import numpy as np
from drake_srg.planning.motion.time_parameterization import load_toppra
load_toppra()
import toppra
from toppra.solverwrapper import ecos_solverwrapper
assert "scipy" not in sys.modules
times, values, middle = np.arange(3.0), np.array([[0.0], [1.0], [0.5]]), [0.5, 1.5]
spline = toppra.SplineInterpolator(times, values)(middle)
simple = toppra.SimplePath(times, values)(np.array(middle))
from scipy.interpolate import CubicSpline
np.testing.assert_array_equal(spline, CubicSpline(times, values)(middle))
assert np.all(np.isfinite(simple))
assert ecos_solverwrapper.scipy.sparse.lil_matrix((2, 3)).shape == (2, 3)
"""
    subprocess.run([sys.executable, "-c", code], check=True)
