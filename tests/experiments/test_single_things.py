"""Meshes are closed, and every thing is a valid object."""

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.single_things import (
    HOUSEHOLD_THINGS,
    MESH_KINDS,
    MESHES,
    SHAPES,
    prism,
    thing,
    tube,
    write_meshes,
)
from drake_srg.objects.household import HOUSEHOLD
from drake_srg.scenario import load_scenario


def volume(vertices, triangles):
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


@pytest.mark.parametrize("kind", MESH_KINDS)
def test_every_edge_has_two_sides_and_faces_look_outwards(kind):
    vertices, triangles = MESH_KINDS[kind]
    edges = {(t[i], t[(i + 1) % 3]) for t in triangles for i in range(3)}
    assert len(edges) == 3 * len(triangles)
    assert all((b, a) in edges for a, b in edges)
    assert volume(vertices, triangles) > 0.0


def test_a_prism_and_a_ring_have_their_volumes():
    square = prism([(0, 0), (2, 0), (2, 2), (0, 2)], (1, 1), 3)
    assert volume(*square) == pytest.approx(12.0)
    ring = tube(1.0, 5.0, 2.0 * np.pi, 200)
    assert volume(*ring) == pytest.approx(2.0 * np.pi**2 * 5.0, rel=0.01)


def test_the_groups_take_their_kinds_in_turn(tmp_path):
    write_meshes(tmp_path)
    assert len({thing(MESHES, i, tmp_path) for i in range(20)}) == len(MESH_KINDS)
    assert len({thing(HOUSEHOLD_THINGS, i, tmp_path) for i in range(40)}) == len(
        HOUSEHOLD
    )
    for group in (MESHES, HOUSEHOLD_THINGS, SHAPES):
        for number in range(3):
            own = f"objects={{thing: {thing(group, number, tmp_path)}}}"
            scenario = load_scenario(
                "clear_table_fast", seed=1, overrides=("clutter.count=0", own)
            )
            assert list(scenario.objects) == ["thing"]
            assert scenario.objects["thing"].drop == 0.005


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ScenarioError, match="cannot be written"):
        write_meshes(tmp_path / "file")
