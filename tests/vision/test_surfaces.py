import numpy as np
import pytest
from helpers import fix
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.sensors import CameraInfo, ImageDepth32F

from drake_srg.vision.camera import CameraModel
from drake_srg.vision.surfaces import CameraLeveling, Surface

WIDTH, HEIGHT = 160, 120
CAMERA = CameraModel(CameraInfo(WIDTH, HEIGHT, np.pi / 4))
TABLE = Surface((-0.5, -0.4), (0.6, 0.4), 0.1)
X_WB = RigidTransform(RollPitchYaw(np.pi - 0.1, 0.05, 0.3), [0.1, -0.05, 1.2])
small = st.floats(-5e-3, 5e-3)


def depth_of_table(X_WB, boxes=0, noise=0.0, seed=0):
    """Return the depth of table and floor [m], with some boxes on the table."""
    rays = CAMERA.imager("depth").rays(slice(0, WIDTH), slice(0, HEIGHT))
    rays_W = rays @ X_WB.rotation().matrix().T
    p = X_WB.translation()
    to_table = (TABLE.height - p[2]) / rays_W[..., 2]
    on_table = TABLE.contains((p + rays_W * to_table[..., None]).reshape(-1, 3))
    depth = np.where(
        on_table.reshape(HEIGHT, WIDTH), to_table, (0.0 - p[2]) / rays_W[..., 2]
    )
    generator = np.random.default_rng(seed)
    for _ in range(boxes):  # 5 cm high
        v, u = generator.integers(0, [HEIGHT - 20, WIDTH - 20])
        depth[v : v + 20, u : u + 20] -= 0.05
    depth += noise * generator.standard_normal(depth.shape)
    return depth.astype(np.float32)


def leveled(depth, X_WB_believed):
    image = ImageDepth32F(WIDTH, HEIGHT)
    image.mutable_data[..., 0] = depth
    system = CameraLeveling(CAMERA, [TABLE])
    context = system.CreateDefaultContext()
    fix(
        system,
        context,
        depth_image=AbstractValue.Make(image),
        body_pose_in_world=AbstractValue.Make(X_WB_believed),
    )
    return system.get_output_port().Eval(context)


def tilt_and_height(X_1, X_2):
    """Return by how much two poses differ in tilt [rad] and in height [m]."""
    up_1, up_2 = (X.rotation().matrix()[2] for X in (X_1, X_2))
    tilt = np.linalg.norm(np.cross(up_1, up_2))
    return tilt, X_1.translation()[2] - X_2.translation()[2]


@pytest.mark.slow
@given(st.tuples(small, small, small), st.tuples(small, small, small))
@settings(max_examples=30, deadline=None)
def test_tilt_and_height_are_corrected_and_nothing_else_changes(turn, shift):
    X_error = RigidTransform(RollPitchYaw(turn), shift)
    X = leveled(depth_of_table(X_WB, boxes=6), X_WB @ X_error)
    tilt, height = tilt_and_height(X, X_WB)
    # Depth is in single precision, 1e-7 of 1.2 m, over half a metre.
    assert tilt < 1e-6
    assert abs(height) < 1e-6
    np.testing.assert_allclose(
        X.translation()[:2], (X_WB @ X_error).translation()[:2], atol=1e-12
    )


def test_noise_is_averaged_out():
    X_believed = X_WB @ RigidTransform(RollPitchYaw(2e-3, -1e-3, 0.0), [0, 0, 1e-3])
    tilts = [
        tilt_and_height(
            leveled(depth_of_table(X_WB, 6, noise=2e-3, seed=seed), X_believed), X_WB
        )[0]
        for seed in range(10)
    ]
    # 2 mm for each of 10,000 pixels, spread over 0.25 m, is 0.08 mrad for each axis.
    # The limit is three times that of both.
    assert np.sqrt(np.mean(np.square(tilts))) < 0.35e-3


@pytest.mark.parametrize("shift", [[0.0, 0.0, 0.3], [3.0, 0.0, 0.0]])
def test_other_surfaces_are_not_taken_for_the_table(shift):
    X_believed = RigidTransform(shift) @ X_WB
    X = leveled(depth_of_table(X_WB), X_believed)
    assert X.IsExactlyEqualTo(X_believed)


def test_a_surface_is_needed():
    with pytest.raises(ValueError, match="at least one surface"):
        CameraLeveling(CAMERA, [])
