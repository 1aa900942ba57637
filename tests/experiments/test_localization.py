import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.experiments import localization
from drake_srg.experiments.localization import SIZES, judge
from drake_srg.experiments.localization_cases import (
    CAMERA,
    LYING,
    RECESS,
    SCENARIO,
    STANDING,
    TILTED,
    Case,
    Sighting,
)
from drake_srg.experiments.registry import quiet
from drake_srg.scenario import load_scenario

SIZE = (640, 480)
GOOD = Sighting(
    RigidTransform([-0.3, -0.2, 0.125]),
    error=np.array([1e-5, -2e-5, 1e-6]),
    turn=1e-3,
    quality=1.0,
    uncertain=False,
)
UNSEEN = dc.replace(GOOD, error=np.full(3, np.nan), turn=np.nan, quality=np.nan)


def of_all(sighting, way=None, size=SIZE):
    """Return good sightings in all cases but one."""
    cases = [Case(w, s) for s in SIZES for w in (STANDING, RECESS, TILTED, LYING)]
    return {c: [GOOD, sighting if c == Case(way, size) else GOOD] for c in cases}


def failed(sightings, thesis=GOOD):
    rows = judge(sightings, thesis, SIZE)
    return {(row.name, row.quantity) for row in rows if not row.passed}


def test_the_scenarios_own_image_size_is_among_the_sizes():
    camera = load_scenario(SCENARIO).cameras[CAMERA]
    assert (camera.width, camera.height) == SIZE
    assert SIZE in SIZES


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


@pytest.mark.slow
def test_it_runs(monkeypatch):
    monkeypatch.setattr(localization, "SIZES", (SIZE,))
    result = localization.run(quiet, grid=2, others=2, scenes=1)
    assert result.passed
    (table,) = result.tables.values()
    assert table["way"] == [STANDING] * 4 + [RECESS] * 2 + [TILTED] * 2 + [LYING] * 2
    assert len(result.figure.axes) == 4
