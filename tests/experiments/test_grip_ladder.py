import pytest

from drake_srg.experiments.grip_ladder import closure_of
from drake_srg.gripper.spool_command import SpoolCommandConfig, spool_angle


@pytest.mark.parametrize("closure", [0.0, 0.3, 0.65, 0.9, 1.0])
def test_a_closure_is_read_back_from_its_spool_angle(closure):
    angle = spool_angle(closure, 0.0076, SpoolCommandConfig())
    assert closure_of(angle, 0.0076) == pytest.approx(closure, abs=1e-3)
