import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

from drake_srg.objects.sdf import (
    DISSIPATION,
    FRICTION,
    MODULUS,
    PROXIMITY,
    AddChild,
    AddContact,
    AddInertial,
    AddPose,
    SetColor,
    SetContact,
    SetMass,
    contact_properties,
    facet_length,
    is_placed,
    sdf_text,
)


def tree(text):
    return ET.fromstring(f"<sdf version='1.9'>{text}</sdf>")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1, "1"),
        (0.1, "0.1"),
        (-0.0, "0"),
        (1e-13, "0"),
        (1.23456789e-5, "1.2346e-05"),
        ([1.0, -2.5], "1 -2.5"),
    ],
)
def test_numbers_are_short(value, text):
    assert sdf_text(value) == text


def test_the_identity_is_no_pose():
    parent = ET.Element("link")
    AddPose(parent, [0, 0, 0])
    assert not is_placed(parent)
    assert len(parent) == 0
    AddPose(parent, [0, 0, 0], [0, 0, 0.1])
    assert is_placed(parent)


@given(st.lists(st.floats(0.01, 0.5), min_size=6, max_size=6))
def test_drake_reads_the_inertia_that_was_written(values):
    size, com = values[:3], np.array(values[3:])
    M = SpatialInertia.SolidBoxWithMass(0.7, *size).Shift(-com)
    root = tree("")
    link = AddChild(AddChild(root, "model", name="m"), "link", name="l")
    AddInertial(link, M)
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(ET.tostring(root, "unicode"), "sdf")
    found = plant.GetBodyByName("l").default_spatial_inertia()
    np.testing.assert_allclose(
        found.CopyToFullMatrix6(), M.CopyToFullMatrix6(), rtol=1e-7, atol=1e-9
    )


def test_inertia_scales_with_mass():
    root = tree(
        "<link><inertial><mass>0.2</mass><inertia><ixx>1</ixx><ixy>-3</ixy></inertia>"
        "</inertial></link>"
    )
    SetMass(root, 0.6)
    assert float(root.findtext(".//mass")) == pytest.approx(0.6)
    assert float(root.findtext(".//ixx")) == pytest.approx(3.0)
    assert float(root.findtext(".//ixy")) == pytest.approx(-9.0)


def test_contact_properties_are_replaced_unless_none():
    root = tree(
        "<a xmlns:drake='http://drake.mit.edu'><drake:proximity_properties>"
        "<drake:mu_static>0.1</drake:mu_static><drake:hydroelastic_modulus>1"
        "</drake:hydroelastic_modulus></drake:proximity_properties></a>"
    )
    values = {"mu_static": 0.5, "mu_dynamic": 0.4, "hydroelastic_modulus": None}
    SetContact(root, values)
    assert [child.text for child in root.find(f".//{PROXIMITY}")] == ["0.5", "1", "0.4"]


def test_every_visual_gets_the_colour():
    root = tree("<visual><material><diffuse>0 0 0 1</diffuse></material></visual>")
    SetColor(root, [0.1, 0.2, 0.3])
    assert [e.text for e in root.iter("diffuse")] == ["0.1 0.2 0.3 1"]


def test_a_circle_has_about_22_sides():
    assert 2 * 3.1416 * 0.03 / facet_length(0.03) == pytest.approx(21, abs=1)


def test_both_forms_say_the_same():
    collision = ET.Element("collision")
    AddContact(collision, 0.01)
    (node,) = collision
    said = {e.tag.rpartition("}")[2]: e.text for e in node}
    properties = contact_properties(FRICTION, MODULUS, 0.01, DISSIPATION)

    def get(group, name):
        return properties.GetProperty(group, name)

    assert float(said["hydroelastic_modulus"]) == MODULUS
    assert get("hydroelastic", "hydroelastic_modulus") == MODULUS
    assert float(said["mesh_resolution_hint"]) == get("hydroelastic", "resolution_hint")
    assert float(said["hunt_crossley_dissipation"]) == DISSIPATION
    assert get("material", "hunt_crossley_dissipation") == DISSIPATION
    tau = get("material", "relaxation_time")
    assert float(said["relaxation_time"]) == pytest.approx(tau)
    friction = get("material", "coulomb_friction")
    assert float(said["mu_static"]) == friction.static_friction() == FRICTION
    assert "compliant_hydroelastic" in said
