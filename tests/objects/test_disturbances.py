import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("!Pusch {}", r"disturbances\[0\]: unknown tag !Pusch \(did you mean '!Push'"),
        ("{at: lift}", r"\[0\]: needs a tag \(allowed: !Force, !Push, !Topple\)"),
        ("!Push {at: flight}", r"\[0\]\.at: must be one of .*close, grasp.* 'flight'"),
        ("!Push {at: failed}", r"\[0\]\.at: must be one of"),
        ("!Push {after: -1}", r"\[0\]\.after: must be at least 0"),
        ("!Push {times: 0}", r"\[0\]\.times: must be at least 1"),
        ("!Push {duration: 0}", r"\[0\]\.duration: must be greater than 0"),
        (
            "!Push {displacement: [1, 2]}",
            r"\[0\]\.displacement: needs 3 numbers, got 2",
        ),
        ("!Push {direction: [1, 2]}", r"\[0\]: unknown key 'direction'"),
        ("!Topple {direction: [0, 0]}", r"\[0\]\.direction: must not be \[0, 0\]"),
        ("!Force {force: 3}", r"\[0\]\.force: must be a list, got 3"),
        (
            "!Force {object: can}",
            r"\[0\]\.object: must be a rigid object, got 'can' \(allowed: thing\)$",
        ),
    ],
)
def test_bad_entries_are_reported_in_one_line(table, entry, message):
    with pytest.raises(ScenarioError, match=message) as error:
        table(f"[{entry}]")
    assert "\n" not in str(error.value)


def test_soft_objects_cannot_be_disturbed(table):
    soft = "objects.thing={soft: {}, shape: !Box {size: [0.05, 0.05, 0.05]}}"
    with pytest.raises(
        ScenarioError, match=r"\[0\]\.object: must be a rigid .* \(allowed: none\)$"
    ):
        table("[!Push {}]", soft)


def test_the_mode_must_be_one_of_the_script():
    push = "disturbances=[!Push {at: verify}]"
    message = r"\[0\]\.at: must be a mode of the script, got 'verify' \(allowed: close,"
    with pytest.raises(ScenarioError, match=message):
        load_scenario("gripper_bench", overrides=[push])
