import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.grip_ladder import closure_of, markdown, run
from drake_srg.experiments.registry import quiet
from drake_srg.gripper.srg_tendon_driver import SpoolCommandConfig, spool_angle


@pytest.mark.parametrize("closure", [0.0, 0.3, 0.65, 0.9, 1.0])
def test_a_closure_is_read_back_from_its_spool_angle(closure):
    angle = spool_angle(closure, 0.0076, SpoolCommandConfig())
    assert closure_of(angle, 0.0076) == pytest.approx(closure, abs=1e-3)


def test_the_table_of_the_docs_has_a_line_per_grip():
    text = markdown({str(i): [float(i), 2.0] for i in range(11)})
    assert len(text.splitlines()) == 4
    assert all(line.count("|") == 12 for line in text.splitlines())


def test_a_gripper_without_wires_is_refused():
    with pytest.raises(ScenarioError, match="gripper: needs !SrgTendonDriver"):
        run(quiet, scenario="kitchen")
