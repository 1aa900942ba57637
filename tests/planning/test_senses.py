import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.planner_machine import HandSenses


def senses(speeds=(0.0, 0.0), proximity=(1.0, 1.0)):
    speeds, proximity = np.array(speeds), np.array(proximity)
    return HandSenses(np.zeros(6), np.zeros(2), speeds, False, proximity, list)


@given(st.permutations([0.0, 0.01, -0.2, 0.03]))
def test_one_finger_that_moves_is_enough_not_to_be_still(speeds):
    assert not senses(speeds=speeds).still
    assert senses(speeds=np.array(speeds) * 0.1).still


@given(st.permutations([0.01, 0.02, 0.0, np.inf]))
def test_one_sensor_that_touches_is_enough_not_to_be_clear(proximity):
    assert not senses(proximity=proximity).clear
    assert senses(proximity=np.array(proximity) + 0.002).clear
