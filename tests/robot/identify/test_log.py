import dataclasses as dc

import numpy as np
import pytest
from helpers import check_reads_or_refuses, damaged
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.identify.log import (
    COLUMNS,
    log_text,
    parse_log,
    read_log,
    vendor_log,
)

ROWS = vendor_log()


def text(rows=ROWS, columns=COLUMNS):
    lines = [line.split(",") for line in log_text(rows).splitlines()]
    places = [lines[0].index(column) for column in columns]
    return "\n".join(",".join(line[k] for k in places) for line in lines)


def test_the_vendors_rows_ship_with_the_package():
    tests = [row.test for row in ROWS]
    assert [tests.count(t) for t in ("position", "torque", "heating")] == [9, 12, 5]
    assert ROWS[0].label == "position 20 %"


def test_what_is_written_is_read():
    read = parse_log(log_text(ROWS), "log")
    # As tuples: from Python 3.13 on, rows with a NaN differ from themselves.
    np.testing.assert_equal(
        *([dc.astuple(row) for row in rows] for rows in (read, ROWS))
    )


def test_a_row_of_heating_goes_on_where_the_one_before_ended():
    before = [row.before_ma for row in ROWS if row.test == "heating"]
    assert before == pytest.approx([float("nan"), 564, 1129, 1693, 753], nan_ok=True)
    # A motor that has cooled down has rested.
    cool = text().replace(",38", ",30").replace("38.0", "30.0")
    before = [row.before_ma for row in parse_log(cool, "log") if row.test == "heating"]
    assert np.isnan(before).tolist() == [True, True, True, False, False]


def test_columns_may_stand_in_any_order():
    shuffled = parse_log(text(columns=COLUMNS[::-1]), "log")
    assert text(shuffled) == text()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.replace("stop_counts", "stop"), "missing column stop_counts"),
        (lambda s: s.replace("test,", "test,note,", 1), "column note"),
        (lambda s: s + "\n" + "9" * 200_000, "not a CSV file: field larger"),
        (
            lambda s: s.replace("558.0", "nan"),
            "line 3: current_ma: must be 10 .. 20000",
        ),
        (lambda s: s.replace("558.0", "0.558"), "line 3: current_ma: must be 10"),
        (
            lambda s: s.replace("558.0", "558 mA"),
            "current_ma: must be a number without",
        ),
        (lambda s: s.replace(",558.0", ","), "line 3: current_ma: must not be empty"),
        (
            lambda s: s.replace("position,30", "grasp,30"),
            "line 3: test: must be one of",
        ),
        (lambda s: "\n".join(s.splitlines()[:2]), "test position: needs at least 4"),
        (lambda s: "", "missing column test"),
    ],
)
def test_a_bad_log_gets_one_clear_line(change, message):
    with pytest.raises(ScenarioError, match=message) as caught:
        parse_log(change(text()), "log.csv")
    assert str(caught.value).startswith("log.csv: ")
    assert "\n" not in str(caught.value)


@settings(max_examples=60)
@given(data=st.data())
def test_a_broken_file_gets_one_line(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("log") / "log.csv"
    path.write_bytes(data.draw(damaged(text().encode())))
    check_reads_or_refuses(read_log, path)
