import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation
from drake_srg.vision.camera_errors import CameraErrors, CameraErrorsConfig

WIDTH, HEIGHT, FOCAL = 160, 120, 200.0
X_WB = RigidTransform([0.3, 0.2, 1.5])
PORTS = ("color_image", "depth_image", "body_pose_in_world")


def see(color=128, depth=1.0, time=0.0, seed=0, name="eye", **config):
    """Return the colour (h, w, 4), depth (h, w) and pose of a camera with errors."""
    errors = CameraErrors(
        CameraErrorsConfig(**config), focal=FOCAL, seed=seed, name=name
    )
    context = errors.CreateDefaultContext()
    context.SetTime(time)
    color_image, depth_image = ImageRgba8U(WIDTH, HEIGHT), ImageDepth32F(WIDTH, HEIGHT)
    color_image.mutable_data[:] = color
    depth_image.mutable_data[..., 0] = depth
    for port, value in zip(PORTS, (color_image, depth_image, X_WB), strict=True):
        errors.GetInputPort(port).FixValue(context, value)
    seen = [errors.GetOutputPort(port).Eval(context) for port in PORTS]
    return seen[0].data.copy(), seen[1].data[..., 0].copy(), seen[2]


def step(left, right):
    """Return an image of two halves."""
    return np.where(np.arange(WIDTH) < WIDTH // 2, left, right)


def test_without_errors_nothing_changes():
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (HEIGHT, WIDTH, 4))
    depth = rng.choice([0.0, 0.7, 1.3, np.inf], (HEIGHT, WIDTH)).astype(np.float32)
    seen = see(color, depth)
    np.testing.assert_array_equal(seen[0], color)
    np.testing.assert_array_equal(seen[1], depth)
    assert seen[2].IsExactlyEqualTo(X_WB)


def test_noise_depends_on_seed_name_and_time_alone():
    noise = {"color_noise": 3.0, "depth_noise": 1e-3, "depth_dropout": 0.01}
    first = see(**noise)
    for again, same in (
        (see(**noise), True),
        (see(**noise, time=0.1), False),
        (see(**noise, seed=1), False),
        (see(**noise, name="other"), False),
    ):
        assert np.array_equal(again[0], first[0]) is same
        assert np.array_equal(again[1], first[1]) is same


@pytest.mark.parametrize(("color", "share"), [(0, 0.5), (255, 1.0)])
def test_colour_noise_has_a_part_of_reading_and_a_part_of_photons(color, share):
    # Values beyond the range are cut off, which leaves half of the errors.
    error = see(color, color_noise=20.0)[0][..., :3].astype(float) - color
    assert np.sqrt(2 * (error**2).mean()) == pytest.approx(20.0 * share, rel=0.02)
    assert abs(np.sign(error).mean()) == pytest.approx(0.5, abs=0.03)


def test_exposure_counts_in_stops_and_saturates():
    assert np.all(see(100, exposure=1.0)[0][..., :3] == 200)
    assert np.all(see(100, exposure=-1.0)[0][..., :3] == 50)
    assert np.all(see(100, exposure=2.0)[0][..., :3] == 255)


def test_blur_spreads_an_edge_in_colour_and_frays_it_in_depth():
    color, depth, _ = see(step(0, 200)[:, None], step(1.0, 1.2), blur=2.0)
    across = color[HEIGHT // 2, :, 0].astype(float)
    steps = np.diff(across) / 200
    columns = np.arange(1, WIDTH) - WIDTH / 2
    assert np.sqrt((steps * columns**2).sum()) == pytest.approx(2.0, rel=0.05)
    # Depth has no values in between, but pixels take those of either side.
    assert set(np.unique(depth)) == {np.float32(1.0), np.float32(1.2)}
    beyond = (depth != step(np.float32(1.0), np.float32(1.2))).mean(axis=0)
    assert beyond[WIDTH // 2] == pytest.approx(0.4, abs=0.15)
    assert beyond[: WIDTH // 2 - 10].max() == beyond[WIDTH // 2 + 10 :].max() == 0


@pytest.mark.parametrize("depth", [0.5, 1.0, 2.0])
def test_depth_noise_grows_with_the_square_of_depth(depth):
    seen = see(depth=depth, depth_noise=2e-3)[1]
    assert seen.std() == pytest.approx(2e-3 * depth**2, rel=0.01)
    # Correlated errors: as uncertain as the mean of a sixth as many independent ones.
    assert seen.mean() == pytest.approx(
        depth, abs=4 * seen.std() * np.sqrt(6 / seen.size)
    )
    beside = np.corrcoef(seen[:, 1:].ravel(), seen[:, :-1].ravel())[0, 1]
    assert 0.3 < beside < 0.8
    far = np.corrcoef(seen[:, 6:].ravel(), seen[:, :-6].ravel())[0, 1]
    assert abs(far) < 0.05


def test_depth_is_lost_at_random_and_more_on_slants_and_edges():
    assert (see(depth_dropout=0.05)[1] == 0).mean() == pytest.approx(0.05, abs=0.01)
    # At 1 m a pixel is 1 / FOCAL wide: this slants by 60 degrees, tangent 1.7.
    slant = 1.0 + np.sqrt(3) / FOCAL * (np.arange(HEIGHT)[:, None] - HEIGHT / 2)
    share = (see(depth=slant, depth_dropout=0.05)[1] == 0)[HEIGHT // 2 - 5 :][:10]
    assert share.mean() == pytest.approx(0.05 * (1 + 3), abs=0.04)
    edge = see(depth=step(1.0, 1.5), depth_dropout=0.05)[1] == 0
    assert edge[:, WIDTH // 2 - 1 : WIDTH // 2 + 1].mean() > 0.4
    assert edge[:, : WIDTH // 4].mean() == pytest.approx(0.05, abs=0.01)


def test_pixels_without_depth_get_none():
    depth = step(0.0, np.inf)
    seen = see(depth=depth, depth_noise=1e-3, depth_dropout=0.3)[1]
    np.testing.assert_array_equal(seen, np.broadcast_to(depth, seen.shape))


def test_the_calibration_error_is_in_the_cameras_frame():
    pose = see(translation=[1e-3, 0.0, 2e-3], rotation=[0.0, 0.0, 0.01])[2]
    X_BE = X_WB.inverse() @ pose
    assert X_BE.translation() == pytest.approx([1e-3, 0.0, 2e-3])
    angle_axis = X_BE.rotation().ToAngleAxis()
    assert angle_axis.angle() * angle_axis.axis() == pytest.approx([0.0, 0.0, 0.01])


@pytest.mark.slow
def test_a_station_outputs_its_cameras_errors():
    errors = "{depth_noise: 1.0e-3, translation: [0.001, 0.0, 0.0]}"
    small = ["cameras.ceiling.width=64", "cameras.ceiling.height=48"]
    exact, noisy = (
        MakeStation(load_scenario("kitchen", seed=0, overrides=overrides))
        for overrides in (small, [*small, f"camera_errors.ceiling={errors}"])
    )

    def evaluate(station, name):
        port = station.GetOutputPort(f"camera_ceiling.{name}")
        return port.Eval(station.CreateDefaultContext())

    off = evaluate(exact, PORTS[2]).inverse() @ evaluate(noisy, PORTS[2])
    assert off.translation() == pytest.approx([0.001, 0.0, 0.0])
    colors = [evaluate(station, PORTS[0]).data for station in (exact, noisy)]
    assert np.array_equal(*colors)
    depth = [evaluate(station, PORTS[1]).data for station in (exact, noisy)]
    error = depth[1] - depth[0]
    assert 1e-3 < error[np.isfinite(error)].std() < 6e-3


def test_errors_of_an_unknown_camera_are_refused():
    with pytest.raises(ScenarioError, match=r"camera_errors: unknown camera 'attic'"):
        load_scenario("kitchen", overrides=["camera_errors.attic.blur=1.0"])
