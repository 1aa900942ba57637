import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.meshes.files import MeshFile
from drake_srg.objects.meshes.links import read_link
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
