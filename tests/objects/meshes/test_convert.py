import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.objects.meshes import pieces
from drake_srg.objects.meshes.convert import DENSITY, MODEL, convert, read_report
from drake_srg.objects.meshes.links import read_link
from drake_srg.objects.meshes.load import import_model
from drake_srg.objects.models import simple_shape
from drake_srg.types import Cylinder
from objects.meshes.made_meshes import box, elbow, write_obj, write_stl
from objects.meshes.test_links import CYLINDER, collision, urdf

UNITS = {1.0: "m", 0.001: "mm", 0.0254: "inches"}


@settings(max_examples=15)  # each takes 0.2 s
@given(
    size=st.lists(st.floats(0.01, 0.3), min_size=3, max_size=3),
    at=st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3),
    rpy=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    unit=st.sampled_from(sorted(UNITS)),
    write=st.sampled_from([write_obj, write_stl]),
)
def test_any_box_has_its_volume_and_inertia(
    tmp_path_factory, size, at, rpy, unit, write
):
    folder = tmp_path_factory.mktemp("box")
    R = RollPitchYaw(rpy).ToRotationMatrix().matrix()
    vertices, faces = box(size, at, R)
    path = write(folder / f"a.{write.__name__[-3:]}", (vertices / unit, faces))
    made = import_model(path, unit, 32, quiet=True)
    report = read_report(made)
    volume = float(np.prod(size))
    assert report.volume == pytest.approx(volume, rel=1e-5)
    assert report.mass == pytest.approx(DENSITY * volume, rel=1e-5)
    assert report.pieces == 1
    assert max(report.excess, report.gap) < 1e-4
    M = read_link(made / MODEL).inertia
    central = M.Shift(M.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    x2, y2, z2 = np.square(size)
    moments = report.mass / 12 * np.array([y2 + z2, x2 + z2, x2 + y2])
    expected = R @ np.diag(moments) @ R.T
    np.testing.assert_allclose(central, expected, atol=2e-5 * moments.max())
    # The box stands on z = 0, its middle above the origin unless the file's origin is
    # underneath it.
    facts = object_facts("box", ObjectConfig(model=str(made / MODEL)))
    assert facts.low[2] == pytest.approx(0.0, abs=1e-6)
    assert np.all(facts.low[:2] <= 1e-6) and np.all(facts.high[:2] >= -1e-6)
    np.testing.assert_allclose(M.get_com()[2], 0.5 * facts.size[2], atol=1e-5)


def converted(path, most=32):
    return read_report(import_model(path, 1.0, most, quiet=True))


def test_a_cylinder_stays_one_that_the_localizer_knows(tmp_path):
    path = urdf(
        tmp_path / "a.urdf",
        collision("<cylinder radius='0.03' length='0.1'/>", "<origin xyz='0 0 0.05'/>"),
    )
    config = ObjectConfig(model=str(path))
    assert simple_shape("a", config) == Cylinder(0.03, 0.1)
    assert object_facts("a", config).low[2] == pytest.approx(-0.05)


def test_a_lying_cylinder_is_not_one_that_the_localizer_knows(tmp_path):
    pose = "<origin rpy='1.5707963267948966 0 0'/>"
    path = urdf(
        tmp_path / "a.urdf", collision("<cylinder radius='0.03' length='0.1'/>", pose)
    )
    config = ObjectConfig(model=str(path))
    assert simple_shape("a", config) is None
    facts = object_facts("a", config)
    np.testing.assert_allclose(facts.size, [0.06, 0.1, 0.06], atol=1e-9)
    assert facts.low[2] == pytest.approx(0.0, abs=1e-9)


def test_placeholder_inertia_is_replaced(tmp_path):
    inertia = "<inertia ixx='1e-3' iyy='1e-3' izz='1e-3' ixy='0' ixz='0' iyz='0'/>"
    inertial = f"<inertial><mass value='0.2'/>{inertia}</inertial>"
    path = urdf(tmp_path / "a.urdf", inertial, CYLINDER)
    report = converted(path)
    assert any("implausible inertia" in warning for warning in report.warnings)
    M = read_link(import_model(path, 1.0, 32) / MODEL).inertia
    moments = M.CalcRotationalInertia().get_moments()
    side = 0.2 * (3 * 0.03**2 + 0.1**2) / 12
    np.testing.assert_allclose(moments, [side, side, 0.2 * 0.03**2 / 2], rtol=1e-6)


def test_plausible_inertia_is_kept(tmp_path):
    inertia = "<inertia ixx='3e-4' iyy='3e-4' izz='1e-4' ixy='0' ixz='0' iyz='0'/>"
    inertial = f"<inertial><mass value='0.2'/>{inertia}</inertial>"
    path = urdf(tmp_path / "a.urdf", inertial, CYLINDER)
    M = read_link(import_model(path, 1.0, 32) / MODEL).inertia
    moments = M.CalcRotationalInertia().get_moments()
    np.testing.assert_allclose(moments, [3e-4, 3e-4, 1e-4], rtol=1e-6)
    assert converted(path).warnings == ["no visual geometry: took the collision one"]


def test_an_open_mesh_counts_as_solid(tmp_path):
    vertices, faces = box([0.04, 0.05, 0.06])
    report = converted(write_obj(tmp_path / "a.obj", (vertices, faces[2:])))
    assert report.volume == pytest.approx(0.04 * 0.05 * 0.06)
    assert "the mesh is open at 4 edges" in report.warnings[0]


@pytest.mark.parametrize(
    ("most", "advice"),
    [(1, "try more pieces"), (32, "a sphere or a cylinder of an SDF")],
)
def test_bad_pieces_are_told(tmp_path, monkeypatch, most, advice):
    """More pieces help only if there were as many as allowed."""
    hull = np.asarray(elbow()[0])
    monkeypatch.setattr(pieces, "_cut", lambda mesh, most: [hull])
    report = converted(write_obj(tmp_path / "a.obj", elbow()), most)
    assert report.excess == pytest.approx(0.03, abs=1e-3)
    (told,) = [text for text in report.warnings if "stand out" in text]
    assert told.startswith("pieces stand out of the mesh by up to 29")
    assert advice in told


def test_an_object_larger_than_the_table_is_refused(tmp_path):
    path = urdf(tmp_path / "a.urdf", collision("<box size='3 3 3'/>"))
    with pytest.raises(ScenarioError, match=r"a\.urdf: is 3 x 3 x 3 m large"):
        convert(read_link(path), 32, tmp_path)
