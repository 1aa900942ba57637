"""Grippers with pads of any friction, both shapes and both materials."""

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.experiments.linkage_pads import MATERIALS, MODELS, Pads, write_model
from drake_srg.parsing import configure_parser


def contacts(path):
    """Return friction and hydroelastic modulus, None if rigid, by geometry."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    parser = Parser(plant)
    configure_parser(parser)
    parser.AddModels(str(path))
    inspector = scene_graph.model_inspector()
    found = {}
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        properties = inspector.GetProximityProperties(geometry)
        friction = properties.GetProperty("material", "coulomb_friction")
        key = ("hydroelastic", "hydroelastic_modulus")
        modulus = properties.GetProperty(*key) if properties.HasProperty(*key) else None
        found[inspector.GetName(geometry)] = (friction.dynamic_friction(), modulus)
    return found


@given(
    st.sampled_from(sorted(MODELS)),
    st.sampled_from(sorted(MATERIALS)),
    st.floats(0.01, 1.0),
    st.floats(0.55, 1.0),
)
@settings(max_examples=12)
def test_the_pads_rub_as_asked_and_nothing_else_changes(shape, material, mu, own):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gripper.sdf"
        write_model(Pads(shape, material, mu), own, path)
        found = contacts(path)
    moduli = set()
    for name, (friction, modulus) in found.items():
        if "_pad" in name:
            assert 2.0 * friction * own / (friction + own) == pytest.approx(
                mu, rel=1e-4
            )
            moduli.add(modulus)
        else:
            assert (friction, modulus) == (0.4, None)
    assert moduli == ({None} if material == "hard" else {2.0e6, 2.2e6})
    assert sum("_pad" in name for name in found) == (2 if shape == "flat" else 6)


def test_a_friction_that_the_rule_cannot_give_is_refused(tmp_path):
    path = tmp_path / "gripper.sdf"
    with pytest.raises(
        ValueError, match=r"less than 0\.6, twice the object's, got 0\.6"
    ):
        write_model(Pads("flat", "hard", 0.6), 0.3, path)
    assert not path.exists()
