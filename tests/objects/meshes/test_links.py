import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.meshes.files import MeshFile
from drake_srg.objects.meshes.links import read_link
from drake_srg.objects.meshes.load import import_model
from drake_srg.types import Box, Cylinder, Sphere
from objects.meshes.made_meshes import box, write_obj

MASS = "<mass value='0.2'/>"
INERTIA = "<inertia ixx='2e-4' iyy='3e-4' izz='4e-4' ixy='0' ixz='0' iyz='0'/>"


def urdf(path, *elements, links=1, head=""):
    link = f"<link name='l{{}}'>{''.join(elements)}</link>"
    text = "".join(link.format(i) for i in range(links))
    path.write_text(f"{head}<robot name='r'>{text}</robot>")
    return path


def collision(geometry, pose=""):
    return f"<collision>{pose}<geometry>{geometry}</geometry></collision>"


CYLINDER = collision("<cylinder radius='0.03' length='0.1'/>")


@pytest.mark.parametrize(
    ("geometry", "shape"),
    [
        ("<cylinder radius='0.03' length='0.1'/>", Cylinder(0.03, 0.1)),
        ("<box size='0.1 0.2 0.3'/>", Box([0.1, 0.2, 0.3])),
        ("<sphere radius='0.04'/>", Sphere(0.04)),
    ],
)
def test_urdf_primitives(tmp_path, geometry, shape):
    pose = "<origin xyz='0.1 0.2 0.3' rpy='0 0 1.5707963'/>"
    contents = read_link(urdf(tmp_path / "a.urdf", collision(geometry, pose)))
    (touched,) = contents.collisions
    assert touched.shape == shape
    np.testing.assert_allclose(touched.X_LG.translation(), [0.1, 0.2, 0.3])
    np.testing.assert_allclose(touched.X_LG.rotation().col(0), [0, 1, 0], atol=1e-6)


def test_an_sdf_says_the_same(tmp_path):
    path = tmp_path / "a.sdf"
    path.write_text(
        "<sdf version='1.9' xmlns:drake='drake.mit.edu'><model name='m'>"
        "<link name='l'><inertial><pose>0 0 0.1 0 0 0</pose><mass>0.2</mass><inertia>"
        "<ixx>2e-4</ixx><iyy>3e-4</iyy><izz>4e-4</izz></inertia></inertial>"
        "<collision name='c'><pose>0.1 0 0 0 0 0</pose><geometry><cylinder>"
        "<radius>0.03</radius><length>0.1</length></cylinder></geometry>"
        "<drake:proximity_properties/></collision><visual name='v'><geometry><box>"
        "<size>0.1 0.1 0.1</size></box></geometry><material><diffuse>0.1 0.2 0.3 1"
        "</diffuse></material></visual></link></model></sdf>"
    )
    contents = read_link(path)
    assert contents.collisions[0].shape == Cylinder(0.03, 0.1)
    assert contents.collisions[0].contact is not None
    assert contents.visuals[0].color == (0.1, 0.2, 0.3)
    assert contents.mass == 0.2
    np.testing.assert_allclose(contents.inertia.get_com(), [0, 0, 0.1])
    assert contents.warnings == []


def test_urdf_inertia_is_about_the_centre_of_mass(tmp_path):
    inertial = f"<inertial><origin xyz='0 0 0.1'/>{MASS}{INERTIA}</inertial>"
    contents = read_link(urdf(tmp_path / "a.urdf", inertial, CYLINDER))
    M = contents.inertia
    central = M.Shift(M.get_com()).CalcRotationalInertia().get_moments()
    np.testing.assert_allclose(central, [2e-4, 3e-4, 4e-4])


@pytest.mark.parametrize(
    ("inertial", "mass"),
    [
        ("", None),
        ("<inertial/>", None),
        ("<inertial><mass value='0'/></inertial>", None),
        (f"<inertial>{MASS}</inertial>", 0.2),
        # No body has a moment that exceeds the sum of the other two.
        (f"<inertial>{MASS}<inertia ixx='1' iyy='1' izz='9'/></inertial>", 0.2),
    ],
)
def test_impossible_inertia_is_none(tmp_path, inertial, mass):
    contents = read_link(urdf(tmp_path / "a.urdf", inertial, CYLINDER))
    assert (contents.mass, contents.inertia) == (mass, None)


@pytest.mark.parametrize(
    "head", ["<xml version='0.0' ?>\n", "\n<?xml version='1.0'?>", "<?xml verson='1'?>"]
)
def test_an_invalid_header_is_left_out(tmp_path, head):
    contents = read_link(urdf(tmp_path / "a.urdf", CYLINDER, head=head))
    assert "left out the invalid XML header" in contents.warnings


def test_the_other_geometry_stands_in_for_a_missing_one(tmp_path):
    contents = read_link(urdf(tmp_path / "a.urdf", CYLINDER))
    assert contents.visuals == contents.collisions
    assert contents.warnings == ["no visual geometry: took the collision one"]
    seen = CYLINDER.replace("collision", "visual")
    contents = read_link(urdf(tmp_path / "a.urdf", seen))
    assert contents.visuals == contents.collisions
    assert contents.warnings == ["no collision geometry: took the visual one"]


@pytest.mark.parametrize(
    "uri",
    [
        "m/a.obj",
        "package://thing/m/a.obj",
        "model://thing/m/a.obj",
        "file://{}/m/a.obj",
    ],
)
def test_meshes_are_found(tmp_path, uri):
    folder = tmp_path / "thing"
    (folder / "m").mkdir(parents=True)
    write_obj(folder / "m" / "a.obj", box([1, 1, 1]))
    uri = uri.format(folder)
    mesh = collision(f"<mesh filename='{uri}' scale='0.1 0.2 0.3'/>")
    contents = read_link(urdf(folder / "a.urdf", mesh))
    shape = contents.collisions[0].shape
    assert isinstance(shape, MeshFile)
    assert shape.path.samefile(folder / "m" / "a.obj")
    assert contents.mesh_files() == [shape.path]
    np.testing.assert_allclose(shape.scale, [0.1, 0.2, 0.3])


def test_meshes_of_our_package_are_found(tmp_path):
    uri = "package://drake_srg/meshes/011_banana_banana_0_collision.obj"
    contents = read_link(
        urdf(tmp_path / "a.urdf", collision(f"<mesh filename='{uri}'/>"))
    )
    assert contents.mesh_files()[0].is_file()
    with pytest.raises(ScenarioError, match="does not exist"):
        mesh = collision("<mesh filename='package://drake_srg/meshes/no.obj'/>")
        read_link(urdf(tmp_path / "a.urdf", mesh))


@pytest.mark.parametrize(
    ("elements", "problem"),
    [
        ([], "its link has no geometry"),
        ([collision("<capsule radius='1' length='1'/>")], "unknown geometry <capsule>"),
        ([collision("")], "<collision>: needs one geometry, got 0"),
        ([collision("<box size='1 2'/>")], "size: needs 3 finite numbers, got '1 2'"),
        ([collision("<box size='1 2 nan'/>")], "needs 3 finite numbers"),
        ([collision("<sphere radius='-1'/>")], "must be greater than 0"),
        ([collision("<sphere/>")], "radius: needs a finite number, got None"),
        ([collision("<mesh filename='no.obj'/>")], "its mesh 'no.obj' does not exist"),
        ([collision("<mesh/>")], "its mesh '' does not exist"),
    ],
)
def test_what_is_not_an_object_is_refused(tmp_path, elements, problem):
    with pytest.raises(ScenarioError, match=rf"a\.urdf: .*{problem}"):
        read_link(urdf(tmp_path / "a.urdf", *elements))


@pytest.mark.parametrize("links", [0, 2])
def test_an_object_has_one_link(tmp_path, links):
    with pytest.raises(ScenarioError, match=f"must have one link, got {links}"):
        read_link(urdf(tmp_path / "a.urdf", CYLINDER, links=links))


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("<robot", "cannot be read"),
        ("hello", "cannot be read"),
        ("<mujoco/>", "must hold <robot> .URDF. or <sdf>, got <mujoco>"),
    ],
)
def test_another_file_is_refused(tmp_path, content, problem):
    path = tmp_path / "a.urdf"
    path.write_text(content)
    with pytest.raises(ScenarioError, match=problem):
        read_link(path)


def test_a_pose_relative_to_another_frame_is_refused(tmp_path):
    path = tmp_path / "a.sdf"
    path.write_text(
        "<sdf version='1.9'><model name='m'><link name='l'><visual name='v'>"
        "<pose relative_to='x'>0 0 0 0 0 0</pose><geometry><sphere><radius>1</radius>"
        "</sphere></geometry></visual></link></model></sdf>"
    )
    with pytest.raises(ScenarioError, match="must be relative to the link"):
        read_link(path)


# Against Drake's own reading of the same file.


def drakes_reading(path):
    """Return what Drake reads: inertia, what is seen, and what is touched."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    (model,) = Parser(plant).AddModels(str(path))
    (body,) = [plant.get_body(i) for i in plant.GetBodyIndices(model)]
    inspector = scene_graph.model_inspector()
    frame = plant.GetBodyFrameIdOrThrow(body.index())

    def geometries(role):
        found = inspector.GetGeometries(frame, role)
        return sorted(found, key=lambda g: g.get_value())

    def value(properties, group, name):
        found = properties.HasProperty(group, name)
        return properties.GetProperty(group, name) if found else None

    seen = [
        (
            inspector.GetPoseInFrame(g),
            value(inspector.GetPerceptionProperties(g), "phong", "diffuse"),
        )
        for g in geometries(Role.kPerception)
    ]
    touched = [
        (
            inspector.GetPoseInFrame(g),
            value(inspector.GetProximityProperties(g), "material", "coulomb_friction"),
        )
        for g in geometries(Role.kProximity)
    ]
    return body.default_spatial_inertia(), seen, touched


def check_like_drake(path):
    contents = read_link(path)
    inertia, seen, touched = drakes_reading(path)
    if contents.inertia is not None:
        assert contents.mass == pytest.approx(inertia.get_mass())
        np.testing.assert_allclose(
            contents.inertia.CopyToFullMatrix6(), inertia.CopyToFullMatrix6(), atol=1e-9
        )
    for ours, (X_LG, color) in zip(contents.visuals, seen, strict=True):
        assert ours.X_LG.IsNearlyEqualTo(X_LG, 1e-9)
        assert (ours.color is None) == (color is None)
        if color is not None:
            assert ours.color == pytest.approx((color.r(), color.g(), color.b()))
    for ours, (X_LG, friction) in zip(contents.collisions, touched, strict=True):
        assert ours.X_LG.IsNearlyEqualTo(X_LG, 1e-9)
        if ours.friction is not None:
            told = (friction.static_friction(), friction.dynamic_friction())
            assert ours.friction == told
    return contents


NUMBERS = st.floats(-3.0, 3.0).map(lambda x: round(x, 3))
TRIPLES = st.lists(NUMBERS, min_size=3, max_size=3)
HUES = st.lists(st.sampled_from([0.0, 0.25, 1.0]), min_size=3, max_size=4)
SHARES = st.sampled_from([0.0, 0.1, 0.5])


def words(values):
    return " ".join(map(repr, values))


@st.composite
def sdf_poses(draw):
    """Draw the text of a pose of an SDF in any of its forms."""
    p, rpy = draw(TRIPLES), draw(TRIPLES)
    xyzw = draw(st.lists(NUMBERS, min_size=4, max_size=4))
    if sum(map(abs, xyzw)) < 0.1:
        xyzw = [0, 0, 0, 1]
    degrees = " degrees='true'"
    return draw(
        st.sampled_from(
            [
                "",
                "<pose/>",
                "<pose> </pose>",
                f"<pose>{words(p)} {words(rpy)}</pose>",
                f"<pose>\n {words(p)}\t{words(rpy)}\n</pose>",
                f"<pose{degrees}>{words(p)} {words([60 * x for x in rpy])}</pose>",
                f"<pose rotation_format='quat_xyzw'>{words(p)} {words(xyzw)}</pose>",
                f"<pose rotation_format='euler_rpy'>{words(p)} {words(rpy)}</pose>",
            ]
        )
    )


SPHERE = "<geometry><sphere><radius>0.1</radius></sphere></geometry>"
MOMENTS = "<ixx>2e-4</ixx><iyy>3e-4</iyy><izz>4e-4</izz><ixy>1e-5</ixy>"


@settings(max_examples=25)  # Drake's parser takes 30 ms
@given(
    st.lists(sdf_poses(), min_size=3, max_size=3), HUES, SHARES, SHARES, st.booleans()
)
def test_an_sdf_is_read_as_by_drake(
    tmp_path_factory, poses, rgb, share, more, prefixed
):
    path = tmp_path_factory.mktemp("sdf") / "a.sdf"
    contact = "<drake:proximity_properties><drake:hydroelastic_modulus>1e6"
    contact += "</drake:hydroelastic_modulus></drake:proximity_properties>"
    path.write_text(
        "<?xml version='1.0'?><sdf version='1.9'><model name='m'><link name='l'>"
        f"<inertial>{poses[0]}<mass>0.2</mass><inertia>{MOMENTS}</inertia></inertial>"
        f"<visual name='v'>{poses[1]}{SPHERE}<material><diffuse>{words(rgb)}</diffuse>"
        f"</material></visual><collision name='c'>{poses[2]}{SPHERE}<surface><friction>"
        f"<ode><mu>{share + more}</mu><mu2>{share}</mu2></ode></friction></surface>"
        f"{contact if prefixed else ''}</collision></link></model></sdf>"
    )
    contents = check_like_drake(path)
    assert contents.collisions[0].friction == (share + more, share)
    assert contents.warnings == []


@settings(max_examples=25)
@given(TRIPLES, TRIPLES, HUES.map(lambda rgb: [*rgb[:3], 1.0]), st.sampled_from("abc"))
def test_a_urdf_is_read_as_by_drake(tmp_path_factory, xyz, rpy, rgba, where):
    path = tmp_path_factory.mktemp("urdf") / "a.urdf"
    origin = f"<origin xyz='{words(xyz)}' rpy='{words(rpy)}'/>"
    color = f"<color rgba='{words(rgba)}'/>"
    named = "<material name='paint'/>"
    full = f"<material name='paint'>{color}</material>"
    head, first, second = {  # defined for the robot, or where it is used first or alone
        "a": (full, named, named),
        "b": ("", full, named),
        "c": ("", full, full),
    }[where]
    ball = "<geometry><sphere radius='0.1'/></geometry>"
    path.write_text(
        f"<robot name='r'>{head}<link name='l'><inertial>{origin}{MASS}{INERTIA}"
        f"</inertial><visual>{origin}{ball}{first}</visual><visual>{ball}{second}"
        f"</visual><collision>{origin}{ball}</collision></link></robot>"
    )
    contents = check_like_drake(path)
    assert [seen.color for seen in contents.visuals] == [tuple(rgba[:3])] * 2
    assert contents.warnings == []


def test_contact_properties_of_a_urdf_become_those_of_an_sdf(tmp_path):
    own = "<drake:proximity_properties><drake:mu_static value='0.3'/>"
    own += "<drake:mu_dynamic value='0.2'/></drake:proximity_properties>"
    touched = CYLINDER.replace("</collision>", own + "</collision>")
    contents = read_link(urdf(tmp_path / "a.urdf", touched))
    (collision,) = contents.collisions
    assert [child.text for child in collision.contact] == ["0.3", "0.2"]


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8-sig"])
@pytest.mark.parametrize("declared", [True, False])
def test_text_may_have_any_usual_encoding(tmp_path, encoding, declared):
    path = urdf(tmp_path / "a.urdf", CYLINDER)
    head = f"<?xml version='1.0' encoding='{encoding.removesuffix('-sig')}'?>"
    text = f"{head if declared else ''}<!-- für -->{path.read_text()}"
    path.write_bytes(text.encode(encoding))
    contents = read_link(path)
    assert contents.collisions[0].shape == Cylinder(0.03, 0.1)


RED = "<material name='red'/>"
SCRIPT = "<material><script><name>Gazebo/Red</name></script></material>"


def seen(material):
    visual = CYLINDER.replace("collision", "visual")
    return visual.replace("</visual>", f"{material}</visual>")


def test_a_colour_that_is_not_found_is_told(tmp_path):
    contents = read_link(urdf(tmp_path / "a.urdf", CYLINDER, seen(RED)))
    assert contents.warnings == ["material 'red' has no colour in this file"]
    path = tmp_path / "a.sdf"
    path.write_text(
        "<sdf version='1.9'><model name='m'><link name='l'><visual name='v'>"
        f"{SPHERE}{SCRIPT}</visual><collision name='c'>{SPHERE}</collision></link>"
        "</model></sdf>"
    )
    assert "script is not read" in read_link(path).warnings[0]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("<robot xmlns:xacro='x'><xacro:include filename='b'/></robot>", "of xacro"),
        ("<robot><xacro:include filename='b'/></robot>", "of xacro"),
        (
            "<robot><link name='l'><sphere radius='${m}'/></link></robot>",
            "of xacro",
        ),
        ("<robot xmlns:xacro='x'><link name='l'/></robot>", "has no geometry"),
        ("<robot><!-- <xacro:a/> --><link name='l'/></robot>", "has no geometry"),
        ("<robot><other:tag/></robot>", "must have one link, got 0"),
        pytest.param("<a>" * 200_000, "nested more than 500 elements deep", id="deep"),
        ("<other:robot/>", "unbound prefix: line 1"),
        (
            "<sdf><world><model><link/></model></world></sdf>",
            "must have one link, got 0",
        ),
    ],
)
def test_what_another_program_expands_is_refused_by_name(tmp_path, text, problem):
    path = tmp_path / "a.urdf"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=rf"a\.urdf: .*{problem}"):
        read_link(path)


def test_other_friction_is_told(tmp_path):
    path = urdf(tmp_path / "a.urdf", CYLINDER)
    more = "<gazebo reference='l0'><mu1>0.1</mu1></gazebo></robot>"
    path.write_text(path.read_text().replace("</robot>", more))
    assert "set --friction" in read_link(path).warnings[-1]


def test_a_package_may_be_named_by_its_package_xml(tmp_path):
    folder = tmp_path / "clone-of-it"
    (folder / "urdf").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>thing</name></package>")
    write_obj(folder / "a.obj", box([1, 1, 1]))
    mesh = collision("<mesh filename='package://thing/a.obj'/>")
    contents = read_link(urdf(folder / "urdf" / "a.urdf", mesh))
    assert contents.mesh_files()[0].samefile(folder / "a.obj")


def test_a_missing_package_tells_where_it_was_looked_for(tmp_path):
    mesh = collision("<mesh filename='package://thing/a.obj'/>")
    where = re.escape(str(tmp_path / "thing"))
    with pytest.raises(ScenarioError, match=rf"no package\.xml above .* in {where}"):
        read_link(urdf(tmp_path / "a.urdf", mesh))


@pytest.mark.parametrize(
    ("scale", "advice"),
    [("", "0.001 0.001 0.001"), ("scale='2 2 1'", "0.002 0.002 0.001")],
)
def test_a_mesh_in_millimetres_is_scaled_where_it_is_named(tmp_path, scale, advice):
    """Advice that was tried: the file is read with it."""
    write_obj(tmp_path / "m.obj", box([40, 50, 60]))
    mesh = f"<mesh filename='m.obj' {scale}/>"
    path = urdf(tmp_path / "a.urdf", collision(mesh))
    text = f'give <mesh> the scale "{advice}" in a.urdf'
    with pytest.raises(ScenarioError, match=re.escape(text)):
        import_model(path, 1.0, 32)
    path.write_text(
        path.read_text().replace(mesh, f"<mesh filename='m.obj' scale='{advice}'/>")
    )
    import_model(path, 1.0, 32, quiet=True)
