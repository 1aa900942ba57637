import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.export.describe import _from_roots
from drake_srg.export.meshes import Meshes
from drake_srg.export.model import Joint, Link, Model, numbers
from drake_srg.export.sdf import to_sdf
from drake_srg.export.urdf import to_urdf

IDENTITY = RigidTransform()


def joint(name, parent, child, X_CJ=IDENTITY):
    return Joint(name, "revolute", parent, child, IDENTITY, X_CJ)


def link(name):
    return Link(name, 1.0, np.zeros(3), np.eye(3), IDENTITY)


@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_numbers_read_back(x):
    assert float(numbers(x)) == pytest.approx(x, rel=1e-11, abs=1e-15)


@given(st.permutations(["ab", "bc", "cd", "be"]))
def test_joints_of_parents_come_first(order):
    known = {"a"}
    for each in _from_roots([joint(pair, *pair) for pair in order]):
        assert each.parent in known
        known.add(each.child)


def test_links_that_hold_each_other_are_refused():
    with pytest.raises(ScenarioError, match="joint ab: cannot be exported"):
        list(_from_roots([joint("ab", "a", "b"), joint("ba", "b", "a")]))


@given(
    st.lists(st.sampled_from([1.0, math.inf]), min_size=4, max_size=4),
    st.sampled_from(["revolute", "prismatic"]),
)
def test_urdf_has_every_limit_that_its_readers_require(yourdfpy, limits, kind):
    lower, upper, velocity, effort = limits
    limited = Joint(
        *("ab", kind, "a", "b", IDENTITY, IDENTITY),
        **{"lower": -lower, "upper": upper, "velocity": velocity, "effort": effort},
    )
    text = to_urdf(Model("m", (link("a"), link("b")), (limited,)), Meshes())
    robot = yourdfpy.URDF.load(io.StringIO(text))
    assert robot.validate(), robot.errors
    limit = robot.joint_map["ab"].limit
    assert math.isfinite(limit.effort + limit.velocity)
    if robot.joint_map["ab"].type != "continuous":  # a missing one would mean 0
        assert limit.lower == -min(lower, 1e9)
        assert limit.upper == min(upper, 1e9)


def test_urdf_refuses_an_axis_beside_the_link_and_sdf_takes_it():
    beside = joint("ab", "a", "b", RigidTransform([0.1, 0, 0]))
    model = Model("m", (link("a"), link("b")), (beside,))
    with pytest.raises(ScenarioError, match=r"joint ab: .* \(allowed: --sdf, --mjcf\)"):
        to_urdf(model, Meshes())
    assert "<pose>0.1 0 0 0 0 0</pose>" in to_sdf(model, Meshes())
