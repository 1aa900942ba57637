"""Sightings and refusals of the planner of two arms that carry together."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.carrying.planner import (
    LargeSightings,
)
from drake_srg.planning.pick_and_place.sightings import PickTask, View
from drake_srg.scenario import load_scenario
from drake_srg.station.planners import MakeCarryPlanner
from drake_srg.types import Blob, BlobFlag, Box


def test_an_uncertain_part_of_the_object_is_no_obstacle():
    box = Box([0.7, 0.26, 0.1])
    sightings = LargeSightings(PickTask("crate", box, RigidTransform()), 0.2)

    def blob(x, certain):
        flags = frozenset() if certain else frozenset({BlobFlag.UNCERTAIN})
        X_WO = RigidTransform([x, 0.0, 0.05])
        return Blob("crate", "top", (0.0, 0.0), X_WO, 1.0, flags)

    found = [
        len(sightings.obstacles(View([blob(0.3, certain)]), np.zeros(3)))
        for certain in (True, False)
    ]
    assert found == [1, 0]


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "objects.crate={model: null, shape: !Box {size: [0.7, 0.26, 0.1]}, "
            "mass: 1, friction: 1}",
            r"objects\.crate: must be a model with two end walls",
        ),
        (
            "objects.crate.model=package://drake_srg/sdf/bowl.sdf",
            r"objects\.crate: must be a model with two end walls",
        ),
        (
            "objects.crate.known_scale=0.4",
            r"objects\.crate: must be wider than one hand opens \(136 mm\).*104 mm",
        ),
        (
            "objects.crate.known_scale=3.0",
            r"arms\.left\.gripper: cannot grasp an end wall",
        ),
    ],
)
def test_objects_that_two_hands_cannot_or_need_not_carry_are_refused(override, message):
    with pytest.raises(ScenarioError, match=message):
        MakeCarryPlanner(load_scenario("carry_together", overrides=[override]))
