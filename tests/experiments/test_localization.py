import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.experiments import localization
from drake_srg.experiments.localization import (
    LYING,
    RECESS,
    SIZES,
    STANDING,
    TILTED,
    Case,
    Eye,
    Sighting,
    judge,
    load,
    poses,
)
from drake_srg.experiments.registry import quiet

SIZE = (640, 480)
GOOD = Sighting(
    RigidTransform([-0.3, -0.2, 0.125]),
    error=np.array([1e-5, -2e-5, 1e-6]),
    turn=1e-3,
    quality=1.0,
    uncertain=False,
)
UNSEEN = dc.replace(GOOD, error=np.full(3, np.nan), turn=np.nan, quality=np.nan)


@pytest.fixture(scope="module")
def scenario():
    return load(SIZE)


@pytest.fixture(scope="module")
def eye(scenario):
    return Eye(scenario)


def of_all(sighting, way=None, size=SIZE):
    """Return good sightings in all cases but one."""
    cases = [Case(w, s) for s in SIZES for w in (STANDING, RECESS, TILTED, LYING)]
    return {c: [GOOD, sighting if c == Case(way, size) else GOOD] for c in cases}


def failed(sightings, thesis=GOOD):
    rows = judge(sightings, thesis, SIZE)
    return {(row.name, row.quantity) for row in rows if not row.passed}


def test_the_scenarios_own_image_size_is_among_the_sizes(scenario):
    assert (scenario.cameras["ceiling"].width, 480) == SIZE
    assert SIZE in SIZES


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


@pytest.mark.parametrize(
    ("way", "sighting", "quantity"),
    [
        (STANDING, dc.replace(GOOD, error=np.array([0, 4e-4, 0])), "error in y"),
        (RECESS, dc.replace(GOOD, error=np.array([0, 0, -4e-4])), "error in z"),
        (LYING, dc.replace(GOOD, error=np.array([4e-4, 4e-4, 0])), "error of position"),
        (TILTED, dc.replace(GOOD, turn=np.deg2rad(1.1)), "error of axis"),
    ],
)
def test_the_scenarios_own_image_size_is_judged(way, sighting, quantity):
    assert failed(of_all(GOOD)) == set()
    [(name, found)] = failed(of_all(sighting, way))
    assert name == f"{way}, 640 x 480"
    assert found.endswith(quantity)
    assert failed(of_all(sighting, way, SIZES[0])) == set()


def test_a_cylinder_that_is_not_seen_fails():
    assert ("lying, 640 x 480", "largest error of axis") in failed(
        of_all(UNSEEN, LYING)
    )


def test_errors_at_the_thesiss_place_must_not_exceed_its_own():
    worse = dc.replace(GOOD, error=np.array([7e-5, 7e-5, 1e-3]))
    assert {q[:10] for _, q in failed(of_all(GOOD), worse)} == {"error in x"}


def test_it_runs(monkeypatch):
    monkeypatch.setattr(localization, "SIZES", (SIZE,))
    result = localization.run(quiet, grid=2, others=2, scenes=1)
    assert result.passed
    (table,) = result.tables.values()
    assert table["way"] == [STANDING] * 4 + [RECESS] * 2 + [TILTED] * 2 + [LYING] * 2
    assert len(result.figure.axes) == 4
