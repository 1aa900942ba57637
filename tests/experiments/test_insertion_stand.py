import numpy as np
import pytest

from drake_srg.experiments.insertion_stand import InsertionStand


@pytest.mark.slow
def test_the_same_insertion_seats_twice_and_one_far_beside_does_not():
    stand = InsertionStand("!ArmPositionDriver {}", 0.02, 0.6)
    assert set(stand.rig.contact_forces()) == {"gripper"}  # only contact holds it
    first = stand.insert(np.zeros(3))
    assert abs(first.height) < 1e-4
    assert first.tilt < 1e-3
    beside = stand.insert(np.array([0.0, 0.01, 0.0]))
    assert beside.stood > 2e-3
    assert beside.peak > 1.0
    again = stand.insert(np.zeros(3))
    assert again.height == pytest.approx(first.height, abs=1e-6)
