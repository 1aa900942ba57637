import math

import pytest

from drake_srg.bridges.dynamixel.encoder import encoder_position, goal_angle
from drake_srg.bridges.dynamixel.registers import ControlTable

COUNT = math.tau / 4096  # rad
OPEN = 3298  # position of the open gripper


@pytest.fixture
def table():
    return ControlTable()


@pytest.fixture
def multi_turn(table):
    table["cw_angle_limit"] = table["ccw_angle_limit"] = 4095
    table["resolution_divider"], table["multi_turn_offset"] = 2, -100
    return table


@pytest.mark.parametrize(("turns", "position"), [(0.0, OPEN), (0.25, OPEN - 1024)])
def test_closing_lowers_the_position(table, turns, position):
    assert encoder_position(table, turns * math.tau) == position
    table["goal_position"] = position
    assert goal_angle(table) == pytest.approx(turns * math.tau)


@pytest.mark.parametrize("turns", [-2, 1, 3])
def test_joint_mode_ignores_full_turns(table, turns):
    assert encoder_position(table, turns * math.tau) == OPEN


def test_multi_turn_mode_counts_turns_with_divider_and_offset(multi_turn):
    assert encoder_position(multi_turn, 2 * math.tau) == (OPEN - 8192) // 2 - 100
    multi_turn["goal_position"] = (OPEN - 8192) // 2 - 100
    assert goal_angle(multi_turn) == pytest.approx(2 * math.tau)
