"""The grasp manager, one cycle at a time."""

import pytest

from drake_srg.robot.serve.dex1.hand import FORCES, Grasp, GraspState

IDLE, MOVING, CONTACT, GRASPING = GraspState


def run(grasp, commanded, positions):
    """Return the states that follow, and the last grasp."""
    states = []
    for position in positions:
        grasp = grasp.next(commanded, position)
        states.append(grasp.state)
    return states, grasp


def test_a_command_where_the_fingers_are_moves_nothing():
    grasp = Grasp().next(50.5, 50.0)
    assert (grasp.state, grasp.goal) == (IDLE, 50.0)


def test_fingers_that_something_blocks_grasp_it():
    states, grasp = run(Grasp(), 0.0, [50, 45, 40, 40, 40, 40, 40, 40])
    # Three positions within 2 %, three times; the first stall is at the fifth cycle.
    assert states == [MOVING, *[MOVING] * 5, CONTACT, GRASPING]
    assert grasp.goal == 0.0  # it presses towards the command, with less force
    assert FORCES[GRASPING] < FORCES[MOVING]


def test_at_contact_the_fingers_stay_for_a_cycle():
    _, grasp = run(Grasp(), 0.0, [50, 45, 40, 40, 40, 40, 40])
    assert (grasp.state, grasp.goal) == (CONTACT, 40)


@pytest.mark.parametrize("position", [0.0, 0.9])
def test_fingers_that_meet_grasp_nothing_but_each_other(position):
    states, _ = run(Grasp(), 0.0, [50, *[position] * 6])
    assert states[-1] is GRASPING


def test_fingers_that_creep_where_they_meet_go_on():
    states, _ = run(Grasp(), 0.0, [50, *(0.9 - 0.04 * k for k in range(12))])
    assert set(states) == {MOVING}


@pytest.mark.parametrize("positions", [[10] * 9, [38, 38, 38, 38, 38, 38]])
def test_opening_fingers_and_near_goals_are_no_contact(positions):
    goal = 60.0 if positions[0] == 10 else 35.0
    states, _ = run(Grasp(), goal, positions)
    assert set(states) == {MOVING}


@pytest.fixture
def grasping():
    return run(Grasp(), 10.0, [50, *[40] * 7])[1]


@pytest.mark.parametrize(
    ("commanded", "state"), [(0.0, GRASPING), (11.0, GRASPING), (11.1, MOVING)]
)
def test_only_a_command_to_open_ends_a_grasp(grasping, commanded, state):
    assert grasping.state is GRASPING
    assert grasping.next(commanded, 40.0).state is state


def test_it_rests_where_an_opening_command_ends():
    _, grasp = run(Grasp(), 99.0, [50, 98.5])
    assert grasp.state is MOVING  # the command has not risen in this cycle
    assert grasp.next(99.5, 99.0).state is IDLE
