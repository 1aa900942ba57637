import numpy as np
import pytest

from drake_srg.objects.models import simple_shape
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Box, Cylinder
from experiments.data import household_objects, read_csv, read_yaml

NOT_CONVEX = {"mug", "bowl", "squeeze_bottle", "wrench"}


def test_the_household_objects_are_from_the_ycb_table_and_our_models():
    assert set(household_objects()) == NOT_CONVEX | {
        "005_tomato_soup_can",
        "004_sugar_box",
        "003_cracker_box",
        "056_tennis_ball",
        "water_bottle_500ml",
        "thin_card",
        "pencil",
    }


def test_models_have_the_shapes_that_the_grasps_are_for():
    objects = household_objects()
    sugar, pencil = objects["004_sugar_box"], objects["pencil"]
    assert simple_shape("sugar", sugar) == Box([0.0867, 0.1703, 0.0391])
    assert pencil.shape == Cylinder(0.0036, 0.18)


def test_only_objects_that_are_not_convex_have_several_pieces():
    for name, config in household_objects().items():
        assert (simple_shape(name, config) is None) == (name in NOT_CONVEX)


def test_each_call_returns_new_objects():
    household_objects()["mug"].mass = 9.0
    assert household_objects()["mug"].mass is None


@pytest.mark.slow
@pytest.mark.parametrize("name", household_objects())
def test_household_objects_stand_still(name):
    rig = Rig(bench_scenario(household_objects()[name]))
    rig.advance(0.3)
    log = rig.log()["object_pose.thing"]
    moved = np.linalg.norm(log[-1, :3] - log[0, :3])
    # The ball stands on a facet, which is within 1 % of its radius.
    assert moved < (4e-4 if "ball" in name else 1e-4)
    assert set(rig.contact_forces()) == {"support"}


def test_csv_files_are_read_without_their_comments():
    header, first, *_ = read_csv("tendon_moment_arms.csv")
    assert header == "joint,angle_rad,moment_arm_m"
    assert first.startswith("base,0.000000,")


@pytest.mark.parametrize("read", [read_csv, read_yaml])
def test_a_missing_file_is_an_error(read):
    with pytest.raises(FileNotFoundError):
        read("missing.csv")
