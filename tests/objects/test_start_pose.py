"""The start poses of objects."""

import numpy as np
import pytest
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import X_FO_start
from drake_srg.types import Box, Cylinder, Sphere

SHAPES = [Cylinder(0.03, 0.1), Box([0.04, 0.05, 0.06]), Sphere(0.035)]


@pytest.mark.parametrize("shape", SHAPES)
def test_an_object_stands_upright_on_its_table(shape):
    X = X_FO_start(ObjectConfig(position=[0.3, -0.2], yaw=0.5), shape, 0.1)
    height = {"Cylinder": 0.1, "Box": 0.06, "Sphere": 0.07}[type(shape).__name__]
    np.testing.assert_allclose(X.translation(), [0.3, -0.2, 0.1 + height / 2])
    np.testing.assert_allclose(X.rotation().col(2), [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(
        X.rotation().col(0), [np.cos(0.5), np.sin(0.5), 0], atol=1e-12
    )


def test_an_object_without_a_known_shape_has_its_origin_on_the_table():
    X = X_FO_start(ObjectConfig(position=[0.3, -0.2]), None, 0.1)
    np.testing.assert_array_equal(X.translation(), [0.3, -0.2, 0.1])


def test_a_given_pose_is_used_as_it_is():
    X_FO = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [1.0, 2.0, 3.0])
    config = ObjectConfig(pose=Transform(X_FO))
    for shape in (None, *SHAPES):
        assert X_FO_start(config, shape, 0.1).IsNearlyEqualTo(X_FO, 1e-12)


def test_a_position_must_have_been_drawn():
    with pytest.raises(ValueError, match="has not been drawn"):
        X_FO_start(ObjectConfig(), SHAPES[0], 0.0)
