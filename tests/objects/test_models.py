import numpy as np
import pytest
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    AddMultibodyPlantSceneGraph,
    MultibodyPlantConfig,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.contacts import relaxation_time
from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import (
    AddObject,
    SetDefaultObjectPose,
    SetObject,
    X_FO_start,
    known_shape,
    object_body,
    object_shape,
    simple_shape,
)
from drake_srg.parsing import configure_parser
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


@pytest.mark.parametrize("shape", SHAPES)
def test_an_object_stands_upright_on_its_table(shape):
    X = X_FO_start(ObjectConfig(position=[0.3, -0.2], yaw=0.5), shape, 0.1)
    height = {"Cylinder": 0.1, "Box": 0.06, "Sphere": 0.07}[type(shape).__name__]
    np.testing.assert_allclose(X.translation(), [0.3, -0.2, 0.1 + height / 2])
    np.testing.assert_allclose(X.rotation().col(2), [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(
        X.rotation().col(0), [np.cos(0.5), np.sin(0.5), 0], atol=1e-12
    )


def test_an_object_without_a_known_shape_has_its_origin_on_the_table():
    X = X_FO_start(ObjectConfig(position=[0.3, -0.2]), None, 0.1)
    np.testing.assert_array_equal(X.translation(), [0.3, -0.2, 0.1])


def test_a_given_pose_is_used_as_it_is():
    X_FO = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [1.0, 2.0, 3.0])
    config = ObjectConfig(pose=Transform(X_FO))
    for shape in (None, *SHAPES):
        assert X_FO_start(config, shape, 0.1).IsNearlyEqualTo(X_FO, 1e-12)


def test_a_position_must_have_been_drawn():
    with pytest.raises(ValueError, match="has not been drawn"):
        X_FO_start(ObjectConfig(), SHAPES[0], 0.0)


@pytest.mark.parametrize("excess", [-1e-4, -3.3e-5, -1e-6, 0.0, 1e-9, 2e-5, 1e-4])
def test_a_cylinder_as_long_as_it_is_wide_can_be_touched(excess):
    shape = Cylinder(0.0183, 0.0366 + excess)
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.0, contact_model="hydroelastic")
    plant, _ = AddMultibodyPlant(config, builder)
    for name in ("below", "above"):
        thing = ObjectConfig(shape=shape, mass=0.1, friction=0.5, modulus=1e7)
        model = AddObject(plant, name, thing)
        height = 0.0 if name == "below" else shape.length - 1e-4
        SetDefaultObjectPose(plant, model, RigidTransform([0.002, 0.0, height]))
    plant.Finalize()
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    contacts = plant.get_contact_results_output_port().Eval(context)
    assert contacts.num_hydroelastic_contacts() == 1


def impact(approximation):
    """Return the largest force [N] of a box of rubber that lands on a floor."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=1e-4,
            contact_model="hydroelastic",
            discrete_contact_approximation=approximation,
        ),
        builder,
    )
    parser = Parser(plant)
    configure_parser(parser)
    parser.AddModelsFromUrl("package://drake_srg/sdf/floor.sdf")
    box = ObjectConfig(
        shape=Box([0.04, 0.05, 0.06]), mass=0.25, friction=0.7, modulus=2e6
    )
    (body,) = map(plant.get_body, plant.GetBodyIndices(AddObject(plant, "box", box)))
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetFreeBodyPose(context, body, RigidTransform([0.0, 0.0, -0.7199]))
    plant.SetVelocities(context, [0.0, 0.0, 0.0, 0.0, 0.0, -0.3])  # 0.3 m/s down
    forces = []
    for step in range(200):
        simulator.AdvanceTo(1e-4 * step)
        results = plant.get_contact_results_output_port().Eval(context)
        for i in range(results.num_hydroelastic_contacts()):
            force = results.hydroelastic_contact_info(i).F_Ac_W()
            forces.append(abs(force.translational()[2]))
    return max(forces)


def test_contact_is_damped_alike_in_each_approximation():
    sap, lagged = impact("sap"), impact("lagged")
    assert lagged / 2.0 < sap < 2.0 * lagged


class Scene:
    def __init__(self, config):
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
        model = AddObject(self.plant, "thing", config)
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.body = object_body(self.plant, model)

    def replace(self, config):
        SetObject(self.plant, self.scene_graph, self.context, self.body, config)

    def described(self):
        """Inertia, shapes and contact properties in the context."""
        body = self.plant.get_body(self.body)
        context = self.plant.GetMyContextFromRoot(self.context)
        inertia = body.CalcSpatialInertiaInBodyFrame(context).CopyToFullMatrix6()
        graph = self.scene_graph.GetMyContextFromRoot(self.context)
        inspector = self.scene_graph.get_query_output_port().Eval(graph).inspector()
        (touched,) = self.plant.GetCollisionGeometriesForBody(body)
        seen = self.plant.GetVisualGeometriesForBody(body)
        properties = inspector.GetProximityProperties(touched)
        friction = properties.GetProperty("material", "coulomb_friction")
        hint = properties.GetPropertyOrDefault("hydroelastic", "resolution_hint", 0.0)
        return (
            inertia.tolist(),
            (friction.static_friction(), friction.dynamic_friction()),
            hint,
            [repr(inspector.GetShape(g)) for g in (touched, *seen)],
        )


SOLIDS = [
    ObjectConfig(shape=Box([0.03, 0.05, 0.1]), mass=0.2, friction=0.7),
    ObjectConfig(shape=Cylinder(0.02, 0.1), mass=0.3, friction=0.4),
    ObjectConfig(shape=Sphere(0.03), mass=0.1, friction=0.9, resolution=0.01),
]


@pytest.mark.parametrize("old", SOLIDS)
@pytest.mark.parametrize("new", SOLIDS)
def test_a_replaced_object_is_like_one_that_was_built_so(old, new):
    scene = Scene(old)
    scene.replace(new)
    assert scene.described() == Scene(new).described()


def test_a_model_takes_mass_and_friction():
    scene = Scene(ObjectConfig(model=CAN))
    before = scene.described()
    scene.replace(ObjectConfig(model=CAN, mass=0.7, friction=0.33))
    after = scene.described()
    assert after[1] == (0.33, 0.33)
    assert after[2:] == before[2:]
    scaled = np.array(before[0]) * 0.7 / before[0][5][5]
    assert np.allclose(after[0], scaled)
