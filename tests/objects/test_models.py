import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.contacts import relaxation_time
from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import (
    AddObject,
    known_shape,
    object_shape,
    simple_shape,
)
from drake_srg.types import Box, Cylinder, Sphere

CAN = "package://drake_srg/sdf/005_tomato_soup_can.sdf"
SHAPES = [Cylinder(0.03, 0.1), Box([0.04, 0.05, 0.06]), Sphere(0.035)]


def add(config):
    """Return mass, inertia about the centre of mass, and the geometry's properties."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    model = AddObject(plant, "thing", config)
    plant.Finalize()
    assert plant.GetModelInstanceName(model) == "thing"
    (index,) = plant.GetBodyIndices(model)
    body = plant.get_body(index)
    (geometry,) = plant.GetCollisionGeometriesForBody(body)
    inspector = scene_graph.model_inspector()
    inertia = body.default_spatial_inertia()
    return (
        inertia.get_mass(),
        inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3(),
        inspector.GetProximityProperties(geometry),
        inspector.GetShape(geometry),
        inspector.GetIllustrationProperties(plant.GetVisualGeometriesForBody(body)[0]),
    )


def moments(shape):
    """Return the textbook's moments of inertia of 1 kg about x, y, z."""
    match shape:
        case Cylinder(r, length):
            side = (3 * r**2 + length**2) / 12
            return [side, side, r**2 / 2]
        case Box((a, b, c)):
            return [(b**2 + c**2) / 12, (a**2 + c**2) / 12, (a**2 + b**2) / 12]
        case Sphere(r):
            return [0.4 * r**2] * 3


@pytest.mark.parametrize("shape", SHAPES)
def test_a_shape_becomes_a_solid_body(shape):
    config = ObjectConfig(shape=shape, mass=0.25, friction=0.7, color=[0.1, 0.2, 0.3])
    mass, inertia, properties, geometry, looks = add(config)
    assert mass == 0.25
    np.testing.assert_allclose(inertia, 0.25 * np.diag(moments(shape)), atol=1e-12)
    friction = properties.GetProperty("material", "coulomb_friction")
    assert friction.static_friction() == friction.dynamic_friction() == 0.7
    assert type(geometry).__name__ == type(shape).__name__
    color = looks.GetProperty("phong", "diffuse")
    assert (color.r(), color.g(), color.b()) == pytest.approx((0.1, 0.2, 0.3))


@pytest.mark.parametrize("missing", ["mass", "friction"])
def test_a_shape_needs_mass_and_friction(missing):
    values = {"mass": 0.25, "friction": 0.7, missing: None}
    with pytest.raises(ScenarioError, match=r"^objects\.thing: a shape needs mass and"):
        add(ObjectConfig(shape=SHAPES[0], **values))


def test_a_model_keeps_its_own_mass_and_friction():
    mass, inertia, properties, *_ = add(ObjectConfig(model=CAN))
    # The data sheet's 0.349 kg.
    assert mass == pytest.approx(0.349)
    friction = properties.GetProperty("material", "coulomb_friction")
    assert friction.dynamic_friction() > 0.0
    assert np.all(np.linalg.eigvalsh(inertia) > 0.0)


def test_mass_and_friction_override_the_models():
    _, reference, *_ = add(ObjectConfig(model=CAN))
    mass, inertia, properties, *_ = add(
        ObjectConfig(model=CAN, mass=3 * 0.349, friction=0.0)
    )
    assert mass == pytest.approx(3 * 0.349)
    np.testing.assert_allclose(inertia, 3.0 * reference, rtol=1e-9, atol=1e-15)
    friction = properties.GetProperty("material", "coulomb_friction")
    assert friction.static_friction() == friction.dynamic_friction() == 0.0


@pytest.mark.parametrize("config", [{"model": CAN}, {"shape": SHAPES[0]}])
@pytest.mark.parametrize(
    ("name", "key", "own", "others"),
    [
        ("resolution", ("hydroelastic", "resolution_hint"), 0.01, [0.007]),
        ("modulus", ("hydroelastic", "hydroelastic_modulus"), 5.0e7, [2.0e6]),
        ("dissipation", ("material", "hunt_crossley_dissipation"), 5.0, [0.0, 200.0]),
    ],
)
def test_a_value_overrides_that_of_the_geometry(config, name, key, own, others):
    for value in (None, *others):
        thing = ObjectConfig(**config, mass=0.3, friction=0.5, **{name: value})
        _, _, properties, *_ = add(thing)
        found = properties.GetProperty(*key)
        allowed = 1.1e-3 if name == "resolution" else 1e-6 * own
        assert found == pytest.approx(own if value is None else value, abs=allowed)
        d, tau = (
            properties.GetProperty("material", key)
            for key in ("hunt_crossley_dissipation", "relaxation_time")
        )
        assert tau == pytest.approx(relaxation_time(d))


@pytest.mark.parametrize("shape", SHAPES)
def test_the_planner_knows_a_given_shape(shape):
    assert object_shape("thing", ObjectConfig(shape=shape)) == shape


def sdf(path, geometry, count=1):
    """Write a model with one link to a file and return its URL."""
    collision = f"<collision name='c{{}}'><geometry>{geometry}</geometry></collision>"
    collisions = "".join(collision.format(i) for i in range(count))
    path.write_text(
        "<sdf version='1.9'><model name='m'><link name='l'><inertial><mass>0.1</mass>"
        "<inertia><ixx>1e-4</ixx><iyy>1e-4</iyy><izz>1e-4</izz></inertia></inertial>"
        f"{collisions}</link></model></sdf>"
    )
    return path.as_uri()


@pytest.mark.parametrize(
    ("geometry", "shape"),
    [
        (
            "<cylinder><radius>0.03</radius><length>0.1</length></cylinder>",
            Cylinder(0.03, 0.1),
        ),
        ("<box><size>0.04 0.05 0.06</size></box>", Box([0.04, 0.05, 0.06])),
        ("<sphere><radius>0.035</radius></sphere>", Sphere(0.035)),
    ],
)
def test_a_models_shape_is_that_of_its_collision(tmp_path, geometry, shape):
    config = ObjectConfig(model=sdf(tmp_path / "m.sdf", geometry))
    assert object_shape("thing", config) == shape


def test_a_shape_beside_the_origin_is_not_known(tmp_path):
    url = sdf(tmp_path / "m.sdf", "<box><size>1 1 1</size></box>")
    text = (tmp_path / "m.sdf").read_text()
    pose = "<pose>0 0 0.1 0 0 0</pose></collision>"
    (tmp_path / "m.sdf").write_text(text.replace("</collision>", pose))
    assert known_shape("thing", ObjectConfig(model=url)) is None


@pytest.mark.parametrize(
    "geometry",
    [
        "<cylinder><radius>0.03</radius><length>0.1</length></cylinder>",
        "<box><size>0.04 0.05 0.06</size></box>",
    ],
)
def test_a_model_without_contact_properties_gets_those_of_a_shape(tmp_path, geometry):
    path = tmp_path / "m.sdf"
    sdf(path, geometry)
    visual = f"<visual name='v'><geometry>{geometry}</geometry></visual></link>"
    path.write_text(path.read_text().replace("</link>", visual))
    _, _, properties, *_ = add(ObjectConfig(model=str(path), friction=0.3))
    assert properties.GetProperty("hydroelastic", "hydroelastic_modulus") == 5e7
    friction = properties.GetProperty("material", "coulomb_friction")
    assert friction.static_friction() == 0.3


BALL = "<sphere><radius>1</radius></sphere>"


@pytest.mark.parametrize(
    ("geometry", "count"),
    [(BALL, 0), (BALL, 2), ("<plane><normal>0 0 1</normal></plane>", 1)],
)
def test_a_model_needs_one_simple_collision(tmp_path, geometry, count):
    config = ObjectConfig(model=sdf(tmp_path / "m.sdf", geometry, count))
    with pytest.raises(ScenarioError, match=r"^objects\.thing\.model: .*must have one"):
        object_shape("thing", config)
    assert known_shape("thing", config) is None


@pytest.mark.parametrize("content", ["<sdf", "<sdf version='1.9'/>", "hello"])
def test_a_file_without_a_model_is_refused(tmp_path, content):
    path = tmp_path / "m.sdf"
    path.write_text(content)
    with pytest.raises(ScenarioError, match=r"^objects\.thing"):
        object_shape("thing", ObjectConfig(model=path.as_uri()))


def test_an_object_has_one_link(tmp_path):
    path = tmp_path / "m.sdf"
    path.write_text("<sdf version='1.9'><model name='m'/></sdf>")
    with pytest.raises(ScenarioError, match=r"^objects\.thing.* one link, got 0"):
        add(ObjectConfig(model=path.as_uri()))


def test_a_proxy_stands_for_a_model_of_several_pieces():
    url, box = "package://drake_srg/sdf/peg_square_0100.sdf", Box([0.02, 0.02, 0.1])
    assert simple_shape("peg", ObjectConfig(model=url)) is None
    config = ObjectConfig(model=url, proxy=box, known_scale=0.5)
    assert simple_shape("peg", config) == box
    assert known_shape("peg", config) == box.scaled(0.5)
