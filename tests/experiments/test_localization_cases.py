import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.experiments.localization_cases import (
    LYING,
    RECESS,
    STANDING,
    TILTED,
    Eye,
    load,
    poses,
)

SIZE = (640, 480)


@pytest.fixture(scope="module")
def scenario():
    return load(SIZE)


@pytest.fixture(scope="module")
def eye(scenario):
    return Eye(scenario)


@pytest.mark.parametrize("way", [STANDING, RECESS, TILTED, LYING])
def test_cylinders_touch_the_table_within_the_region(scenario, way):
    region = scenario.task.region
    for X_WO in poses(scenario, way, 9, 60):
        axis = X_WO.rotation().matrix()[:, 2]
        p = X_WO.translation()
        # Lowest point of a cylinder of 50 mm with a radius of 12.5 mm.
        lowest = p[2] - 0.025 * abs(axis[2]) - 0.0125 * np.hypot(axis[0], axis[1])
        if way == RECESS:
            assert lowest == pytest.approx(0.095)
            assert np.linalg.norm(p[:2] - scenario.task.place.position) <= 1e-3
        else:
            assert lowest == pytest.approx(0.1)
            assert np.all(p[:2] >= region.min)
            assert np.all(p[:2] <= region.max)
        assert (axis[2] == pytest.approx(1.0)) == (way in (STANDING, RECESS))


def test_standing_cylinders_cover_the_region(scenario):
    places = np.array(
        [X_WO.translation()[:2] for X_WO in poses(scenario, STANDING, 9, 60)]
    )
    assert places.min(axis=0) == pytest.approx(scenario.task.region.min)
    assert places.max(axis=0) == pytest.approx(scenario.task.region.max)


@pytest.mark.parametrize("way", [STANDING, RECESS, TILTED, LYING])
def test_the_scenario_locates_a_cylinder(scenario, eye, way):
    X_WO = next(poses(scenario, way, 9, 60))
    seen = eye.look(X_WO)
    assert seen.distance < (0.3e-3 if way in (STANDING, RECESS) else 0.5e-3)
    assert seen.turn < np.deg2rad(1.0)
    assert not seen.uncertain


def test_a_cylinder_out_of_sight_is_not_seen(eye):
    seen = eye.look(RigidTransform([5.0, 0.0, 0.1]))
    assert np.isnan(seen.distance)
    assert np.isnan(seen.turn)
