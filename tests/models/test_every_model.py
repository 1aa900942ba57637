"""Checks of every model: parsing, mass, inertia, visuals against collision geometry."""

from __future__ import annotations

import logging
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    Convex,
    Cylinder,
    Mesh,
    ReadObjToTriangleSurfaceMesh,
    Role,
    Sphere,
)

from drake_srg.common.contacts import relaxation_time
from drake_srg.objects.household import HOUSEHOLD
from drake_srg.parsing import models_path
from models.built_models import (
    CAN,
    HOLES,
    NOT_CONVEX,
    PACKAGES,
    SEED,
    Built,
    Distances,
    build,
    extent,
    path_of,
)

LINKAGES = tuple(f"linkage_gripper_{kind}" for kind in ("flat", "fast", "bare"))
ROBOTS = ("srg", "iiwa14", "gantry", "assistive_arm", "linkage_gripper")
WORKPLACE = ("small_table", "small_table_recess", "bench", "bin")
TABLES = ("table", "table_mat", "table_long", "floor", "marker", "lid")
KINDS = ("square", "stepped", "keyed", "bushing", "bushing_chamfer")
PEGS = tuple(f"peg_{kind}_0100" for kind in KINDS)
MODELS = (*ROBOTS, *WORKPLACE, *TABLES, *HOLES, *PEGS, *HOUSEHOLD)
RING = "hole_25_mesh::wall"  # the only mesh that contact takes as it is
MASSES = {"srg": 0.4, "iiwa14": 30.61, "lid": 0.3, "marker": 0.01, CAN: 0.349}
MASSES |= {"011_banana": 0.066, "029_plate": 0.279, "048_hammer": 0.665}


@pytest.mark.slow
@pytest.mark.parametrize("name", (*MODELS, *LINKAGES))
def test_parses_without_a_warning(name, caplog):
    with caplog.at_level(logging.WARNING, logger="drake"):
        built = Built(name)
    assert not caplog.records
    expected = "linkage_gripper" if name in LINKAGES else name
    assert built.plant.GetModelInstanceName(built.model) == expected


@pytest.mark.parametrize(("name", "mass"), MASSES.items())
def test_total_mass(name, mass):
    built = build(name)
    total = built.plant.CalcTotalMass(built.plant_context, [built.model])
    assert total == pytest.approx(mass)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ("srg", "assistive_arm", "linkage_gripper", "lid", "marker", *HOUSEHOLD),
)
def test_inertia_fits_the_bodys_extent(name):
    built = build(name)
    for body in built.bodies():
        M = body.CalcSpatialInertiaInBodyFrame(built.plant_context)
        assert M.IsPhysicallyValid()
        low, high = extent(built, body)
        com = M.get_com()
        assert np.all(low < com + 1e-9) and np.all(com < high + 1e-9)
        moments = M.Shift(com).get_unit_inertia().get_moments()
        x2, y2, z2 = ((high - low) / 2) ** 2
        # At most all mass at the corners of the bounding box, at least a tenth of that.
        most = np.array([y2 + z2, x2 + z2, x2 + y2])
        assert np.all(moments <= most)
        assert np.all(moments >= 0.1 * most)


def surface_points(shape: Any, rng: np.random.Generator) -> np.ndarray:
    """Return random points on a shape's surface, in its own frame, shape (n, 3)."""
    if isinstance(shape, Box):
        p = rng.uniform(-0.5, 0.5, (60, 3))
        rows = np.arange(len(p))
        axis = rng.integers(0, 3, len(p))
        p[rows, axis] = np.sign(p[rows, axis]) / 2
        return p * shape.size()
    if isinstance(shape, Cylinder):
        a = rng.uniform(0, 2 * np.pi, 60)
        r = np.where(rng.random(60) < 0.5, np.sqrt(rng.random(60)), 1.0)
        z = np.where(r < 1, np.sign(rng.normal(size=60)), rng.uniform(-1, 1, 60))
        R, h = shape.radius(), shape.length() / 2
        return np.column_stack([R * r * np.cos(a), R * r * np.sin(a), h * z])
    if isinstance(shape, Sphere):
        p = rng.normal(size=(60, 3))
        return shape.radius() * p / np.linalg.norm(p, axis=1, keepdims=True)
    mesh = ReadObjToTriangleSurfaceMesh(str(path_of(shape)))
    V = np.array(mesh.vertices())
    weights = rng.dirichlet((1, 1, 1), mesh.num_triangles())
    corners = np.array(
        [[t.vertex(i) for i in range(3)] for t in mesh.triangles()], dtype=int
    )
    inside = np.einsum("ij,ijk->ik", weights, V[corners])
    points = np.vstack([inside, V])
    return rng.permutation(points)[:400]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        ("srg", 0.002),
        ("srg_fast", 0.009),
        ("iiwa14", 0.002),
        ("assistive_arm", 0.002),
        ("linkage_gripper", 0.002),
        ("linkage_gripper_flat", 0.002),
        ("table", 0.002),
        ("lid", 0.002),
        (CAN, 3e-4),
    ]
    + [(name, 0.002) for name in (*NOT_CONVEX, *PACKAGES, *WORKPLACE)],
)
def test_visuals_and_collision_geometry_coincide(name, tolerance):
    built = build(name)
    rng = np.random.default_rng(SEED)
    for body in built.bodies():
        seen = built.shapes(body, Role.kIllustration)
        touched = built.shapes(body, Role.kProximity)
        to_seen, to_touched = Distances(seen), Distances(touched)
        for label, shape, X in seen:
            for p in (X @ surface_points(shape, rng).T).T:
                assert min(to_touched.at(p).values()) <= tolerance, (label, p)
        for label, shape, X in touched:
            for p in (X @ surface_points(shape, rng).T).T:
                others = to_touched.at(p)
                del others[label]
                if min(others.values(), default=1) < 0:
                    continue  # inside another piece, where nothing can touch it
                distances = np.abs(list(to_seen.at(p).values()))
                assert distances.min() <= tolerance, (label, p)


@pytest.mark.parametrize("name", MODELS)
def test_collision_geometry_is_convex_or_primitive(name):
    built = build(name)
    for body in built.bodies():
        shapes = built.shapes(body, Role.kProximity)
        assert bool(shapes) == (name not in ("marker", "gantry", "gantry_turning"))
        for label, shape, _ in shapes:
            wanted = Mesh if label == RING else Box | Cylinder | Sphere | Convex
            assert isinstance(shape, wanted), label


@pytest.mark.slow
def test_checked_in_models_match_what_the_script_builds():
    pytest.importorskip("manifold3d")  # only the extra `models` has it
    script = Path(__file__).parents[2] / "tools" / "build_models.py"
    run = subprocess.run(
        [sys.executable, str(script), "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr


def test_meshes_are_small():
    for path in (models_path() / "meshes").iterdir():
        assert path.stat().st_size < 300_000, path.name


@pytest.mark.parametrize("name", MODELS)
def test_contact_dissipates_alike_in_each_approximation(name):
    built = build(name)
    for body in built.bodies():
        for geometry in built.plant.GetCollisionGeometriesForBody(body):
            properties = built.inspector.GetProximityProperties(geometry)
            d = properties.GetPropertyOrDefault(
                "material", "hunt_crossley_dissipation", 0.0
            )
            tau = properties.GetProperty("material", "relaxation_time")
            assert tau == pytest.approx(relaxation_time(d))
