"""`drake-srg run --hardware` goes by the planner's word: nobody else knows."""

import dataclasses as dc
import json

import pytest
from simulation.made_logs import BLOB, judge, make_log

import drake_srg.hardware
from drake_srg.cli.main import main
from drake_srg.simulation.simulate import Result
from drake_srg.types import Mode, PlannerStatus

PARTS = "arm: !Ros2Arm {}\ngripper: !Ros2Gripper {}\n"


def without_truth():
    """Return the log of a robot's run, which does not tell where objects are."""
    log = make_log()
    del log["object_pose.soup_can"], log["contact_force"]
    return log


@pytest.mark.parametrize(("claimed", "code"), [(True, 0), (False, 1)])
def test_the_exit_code_follows_what_is_claimed(
    claimed, code, tmp_path, capsys, monkeypatch
):
    mode = Mode.DONE if claimed else Mode.FAILED
    status = PlannerStatus(mode=mode, attempts=1, localization=BLOB, localized_at=0.0)

    def run(scenario, config, *, out, **_):
        metrics = dc.replace(
            judge(without_truth(), status), success=False, claimed=claimed
        )
        out.mkdir()
        metrics.write(out / "metrics.json")
        return Result(metrics, {}, status)

    monkeypatch.setattr(drake_srg.hardware, "run_on_hardware", run)
    (tmp_path / "robot.yaml").write_text(PARTS)
    out = tmp_path / "out"
    command = ["run", "kitchen", "--hardware", str(tmp_path / "robot.yaml")]
    assert main([*command, "--out", str(out)]) == code
    assert ("done, by the planner's word" in capsys.readouterr().out) == claimed
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["success"] is None
    assert metrics["claimed"] is claimed
    assert metrics["placement_error_m"] is metrics["localization_error_m"] is None
