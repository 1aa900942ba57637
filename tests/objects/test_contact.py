import xml.etree.ElementTree as ET

import pytest

from drake_srg.objects.contact import (
    DISSIPATION,
    FRICTION,
    MODULUS,
    AddContact,
    contact_properties,
    facet_length,
)


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
