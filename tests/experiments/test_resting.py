import dataclasses as dc

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import resting
from drake_srg.experiments.data import household_objects
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.resting import CHOSEN, HALF, count, judge
from drake_srg.experiments.resting_drops import Drop, Motion, simulate, tipping_angle
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import simple_shape
from drake_srg.parsing import models_path
from drake_srg.types import Box

TIME = np.arange(0.0, 13.01, 0.02)
BRICK = ObjectConfig(shape=Box([0.06, 0.04, 0.03]), mass=0.1, friction=0.6)
DROP = Drop("brick", "standing", 0.05)


def motion(soon=0.0, late=0.0, creep=0.0, exploded=False, end=13.0):
    """A motion with these speeds [m/s] and this creep [m], up to an end [s]."""
    time = TIME[end + 1e-9 > TIME]
    speed = np.where(time < 1.0, 1.0, np.where(time < 2.9, soon, late))
    position = np.zeros((len(time), 3))
    position[:, 0] = creep * time / 10.0
    return Motion(time, speed, position, 1e-4, exploded, 1.0)


def failed(**changes):
    found = {Drop("brick", "standing", h): motion() for h in resting.HEIGHTS}
    found[DROP] = motion(**changes)
    motions = {"chosen": found, HALF: found}
    counts = {label: count(drops) for label, drops in motions.items()}
    rows = judge(motions, counts)
    return {(row.name, row.quantity) for row in rows if not row.passed}


@pytest.mark.parametrize(
    ("changes", "quantities"),
    [
        ({}, set()),
        ({"soon": 0.006}, {"moving after 1.2 s"}),
        ({"soon": 0.004, "late": 0.004}, set()),
        ({"late": 0.006}, {"moving after 3 s"}),
        ({"creep": 1.1e-3}, {"creep in 10 s"}),
        ({"exploded": True}, {"explosions"}),
        (
            {"exploded": True, "end": 0.5},
            {
                "explosions",
                *(f"moving after {t} s" for t in ("1.2", "3")),
                "creep in 10 s",
            },
        ),
    ],
)
def test_what_does_not_rest_fails(changes, quantities):
    assert failed(**changes) == {("chosen", quantity) for quantity in quantities}


def test_a_brick_comes_to_rest_and_sinks_in_as_statics_say():
    end = simulate(DROP, BRICK, CHOSEN, 1.5)
    assert not end.exploded
    assert end.fastest(1.2, 1.5) < resting.REST
    # Weight over area, over the mat's modulus per half its thickness of 40 mm.
    depth = 0.1 * 9.81 / (0.06 * 0.04) * 0.02 / CHOSEN.mat
    assert end.sunk == pytest.approx(depth, rel=0.1)


def test_on_facets_a_brick_stands_on_the_table():
    rigid = dc.replace(CHOSEN, mat=0.0, cell=0.02, modulus=1e6, dissipation=200.0)
    end = simulate(DROP, BRICK, rigid, 1.5)
    assert end.fastest(1.2, 1.5) < resting.REST
    assert end.sunk < 1e-4


def test_a_pencil_balances_on_its_end_only():
    pencil = household_objects()["pencil"]
    angles = {pose: tipping_angle(pencil, pose) for pose in resting.POSES}
    assert angles["standing"] == angles["tipped"] < resting.BALANCING
    assert angles["lying"] > resting.BALANCING
    shape = simple_shape("pencil", pencil)
    slope = np.arctan(2.0 * shape.radius / shape.length)
    assert angles["standing"] == pytest.approx(slope, rel=1e-3)


def test_the_compared_objects_exist():
    assert set(resting.COMPARED) <= household_objects().keys()


def test_the_tables_model_has_the_chosen_settings():
    text = (models_path() / "sdf" / "table_mat.sdf").read_text()
    assert f"<drake:hydroelastic_modulus>{CHOSEN.mat:g}<" in text
    assert f"_dissipation>{CHOSEN.mat_dissipation:g}<" in text


def test_an_unknown_object_is_refused():
    with pytest.raises(ScenarioError, match=r"unknown object 'mugg' .*'mug'"):
        resting.run(quiet, objects=["mugg"])


@pytest.mark.slow
def test_a_quick_run_passes():
    result = resting.run(quiet, objects=["004_sugar_box"], quick=True)
    assert result.passed, result.table()
    assert set(result.tables["drops"]["pose"]) == set(resting.POSES)
    assert len(result.figure.axes) == 2
