import copy

import numpy as np

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import PlannerMemory, Trouble
from drake_srg.types import Failure, Mode

REST = Motion(np.zeros(2))


def test_copies_share_what_never_changes():
    memory = PlannerMemory(REST)
    assert copy.deepcopy(memory) is memory


def test_a_failure_is_reported_when_the_task_has_failed():
    trouble = Trouble(failure=Failure.DROPPED, message="lost")
    memory = PlannerMemory(REST, trouble=trouble)
    assert memory.status(Mode.FAILED).failure is Failure.DROPPED
    assert memory.status(Mode.RETREAT).failure is None
    assert memory.status(Mode.RETREAT).message == "lost"
