"""The generated model has the geometry that planning and experiments rely on."""

import xml.etree.ElementTree as ET

import pytest

from drake_srg.common.srg_geometry import SRG
from drake_srg.parsing import models_path

MODEL = ET.parse(models_path() / "sdf" / "srg.sdf").getroot()[0]


def named(kind, name, within=MODEL):
    (element,) = [e for e in within.iter(kind) if e.get("name") == name]
    return element


def pose(element):
    return [float(x) for x in element.find("pose").text.split()]


def box(collision):
    return [float(x) for x in collision.find("geometry/box/size").text.split()]


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
def test_the_hinges_are_where_the_model_has_them(side, sign):
    base, tip = (named("link", f"{side}_{link}_link") for link in ("base", "tip"))
    assert pose(base)[:3] == [SRG.hinge_x, sign * SRG.hinge_y, 0.0]
    assert pose(tip)[:3] == [SRG.base_length, 0.0, 0.0]


@pytest.mark.parametrize("joint", ["left_base", "right_base", "left_tip", "right_tip"])
def test_the_joints_have_the_limits_of_the_model(joint):
    limit = named("joint", f"{joint}_joint").find("axis/limit")
    limits = [float(limit.find(key).text) for key in ("lower", "upper", "velocity")]
    assert limits == [0.0, SRG.joint_limit, SRG.joint_speed]


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_pads_are_boxes_of_that_size_and_place(side):
    pad = named("collision", f"{side}_pad")
    assert box(pad) == [SRG.pad_length, SRG.pad_thickness, SRG.pad_width]
    x, y, z = pose(pad)[:3]
    assert (x, z) == (SRG.pad_middle, 0.0)
    assert x + 0.5 * SRG.pad_length == pytest.approx(SRG.pad_end, abs=1e-12)
    face = y + 0.5 * SRG.pad_thickness
    assert face == pytest.approx(SRG.face_offset, abs=1e-12)


def test_the_palms_face_and_grasp_center_are_where_the_model_has_them():
    face = named("collision", "palm_face")
    x = pose(face)[0] + 0.5 * box(face)[0]
    assert x == pytest.approx(SRG.palm_face_x, abs=1e-12)
    frame = named("frame", "grasp_center")
    assert pose(frame)[:3] == [SRG.grasp_center_x, 0.0, 0.0]


def test_the_palms_parts_are_within_its_bounding_box():
    low = high = 0.0
    for collision in named("link", "palm").iter("collision"):
        size = collision.find("geometry/box/size")
        if size is not None:
            z, height = pose(collision)[2], box(collision)[2]
            low, high = min(low, z - 0.5 * height), max(high, z + 0.5 * height)
    assert low == pytest.approx(-0.5 * SRG.palm_height, abs=1e-6)
    assert high <= 0.5 * SRG.palm_height


def test_derived_lengths_are_those_of_the_vendors_drawings():
    # Knuckle to tip of a straight finger, and the gap between the pads at 90 degrees.
    assert SRG.finger_length == pytest.approx(0.1108, abs=1e-12)
    assert 2.0 * (SRG.hinge_y - SRG.face_offset) == pytest.approx(0.0416, abs=1e-12)
