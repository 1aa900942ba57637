import pytest

from drake_srg.sweeps.rows import read_rows, row_path, write_row
from drake_srg.sweeps.summary import summary
from drake_srg.sweeps.trial import empty_row

from .test_rows import INFO


@pytest.fixture
def summarize(tmp_path):
    """Return the lines of the summary of rows, given what they differ in."""
    INFO.write(tmp_path)

    def run(*rows):
        for trial, values in enumerate(rows):
            write_row(row_path(tmp_path, trial), empty_row(7, trial, "") | values)
        lines = summary(read_rows(tmp_path)).splitlines()
        return [" ".join(line.split()) for line in lines]

    return run


def success(cycle_time):
    return {"success": True, "failure": None, "claimed": True} | {
        "cycle_time_s": cycle_time,
        "time_to_placement_s": cycle_time - 2.0,
        "grasp_lifted": True,
    }


def test_the_summary_counts_outcomes_and_reasons(summarize):
    assert summarize(
        success(7.0),
        success(9.0),
        success(8.0),
        {"failure": "dropped", "grasp_lifted": False},
        {"failure": "dropped", "cycle_time_s": 30.0},
        {"failure": "misplaced", "claimed": True},
    ) == [
        "success 3 of 6, 50.00%",
        "95 % interval (Wilson) 18.76% to 81.24%",
        "grasped and lifted 3 of 4",
        "failure: dropped 2",
        "failure: misplaced 1",
        "wrongly reported done 1",
        "median to placement 6 s",
        "median cycle 8 s",
    ]


def test_the_median_cycle_is_one_that_occurred_as_in_the_report(summarize):
    assert summarize(success(7.0), success(8.0))[-1] == "median cycle 7 s"


@pytest.mark.parametrize("rows", [[], [{}]])
def test_a_sweep_without_successes_has_no_median_cycle(summarize, rows):
    lines = summarize(*rows)
    assert lines[0].startswith(f"success 0 of {len(rows)}")
    assert lines[-1] == "median cycle -"
