import numpy as np
import pytest
from helpers import fix, read
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform

from drake_srg.experiments.sighting_error import SightingError, cell_maker
from drake_srg.scenario import load_scenario
from drake_srg.types import Blob


def test_sightings_are_off_by_the_error():
    system = SightingError(np.array([0.0, 0.004, 0.0]))
    context = system.CreateDefaultContext()
    blob = Blob("a", "b", (1.0, 2.0), RigidTransform(np.ones(3)), 0.9)
    fix(system, context, blobs_seen=AbstractValue.Make([blob]))
    (moved,) = read(system, context, "blobs")
    np.testing.assert_array_equal(moved.position, [1.0, 1.004, 1.0])
    np.testing.assert_array_equal(moved.axis, blob.axis)
    assert (moved.object_name, moved.pixel, moved.quality) == ("a", (1.0, 2.0), 0.9)


@pytest.mark.slow
def test_the_cell_exports_the_localizer_s_own_blobs():
    cell = cell_maker(np.array([0.004, 0.0, 0.0]))(load_scenario("assistive_arm"))
    context = cell.CreateDefaultContext()
    (blob,) = cell.GetOutputPort("localizer.blobs").Eval(context)
    X_WO = cell.GetOutputPort("object_poses_cheat").Eval(context)["cylinder"]
    # Within our own limit, because the exported blobs do not have the error.
    np.testing.assert_allclose(blob.position, X_WO.translation(), atol=3e-4)
