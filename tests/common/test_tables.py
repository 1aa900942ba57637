import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.tables import parse_table, read_json, read_table

COLUMNS = ["name", "x"]


def test_rows_know_their_line(tmp_path):
    path = tmp_path / "a.csv"
    text = "# made by hand\nx, name, note\n\n1, ä,\n# more\n2,'b',\"c, d\"\n"
    path.write_text(text, encoding="utf-8-sig")
    assert read_table(path, COLUMNS) == [
        (f"{path}: line 4", {"name": "ä", "x": "1", "note": ""}),
        (f"{path}: line 6", {"name": "'b'", "x": "2", "note": "c, d"}),
    ]


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("", r"missing column name \(columns: name, x\)"),
        ("name;x\na;1\n", "entries are separated by ';', must be by ','"),
        ("name\tx\na\t1\n", r"entries are separated by '\\t', must be by ','"),
        ("name,x,x\n", "column x twice"),
        ("name,x\na\n", "line 2: needs 2 entries, got 1"),
        ("name,x\na,1,2\n", "line 2: needs 2 entries, got 3"),
        (b"name,x\n\xe4,1\n", "not a CSV file in UTF-8"),
        ("name,x\na,1\n".encode("utf-16"), "not a CSV file in UTF-8"),
        (None, "cannot be read: No such file"),
    ],
)
def test_a_bad_table_gets_one_line(tmp_path, content, problem):
    path = tmp_path / "a.csv"
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ScenarioError, match=rf"a\.csv: .*{problem}"):
        read_table(path, COLUMNS)


def test_columns_may_be_all_that_is_allowed():
    with pytest.raises(ScenarioError, match=r"f: unknown column y \(columns: name, x"):
        parse_table("name,x,y\n", "f", COLUMNS, only=True)


@given(st.text(st.sampled_from("name,x\n\"'#; \0\r1")))
def test_any_text_is_a_table_or_refused(text):
    try:
        rows = parse_table(text, "f", COLUMNS)
    except ScenarioError as error:
        assert str(error).startswith("f: ")
        assert "\n" not in str(error)
    else:
        assert all(set(COLUMNS) <= set(entries) for _, entries in rows)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("{", "invalid content: Expecting"),
        ('{"a": 1, "b": {"c": 1, "c": 2}}', "invalid content: key 'c' twice"),
        ("{}", "invalid content: 'a'"),
        ("[]", "invalid content: list indices"),
        (b"\xff", "invalid content: 'utf-8' codec"),
        ("[" * 100_000, "invalid content: "),
        (None, "cannot be read: No such file"),
    ],
)
def test_a_bad_json_file_gets_one_line(tmp_path, content, problem):
    path = tmp_path / "a.json"
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ScenarioError, match=rf"a\.json: {problem}"):
        read_json(path, lambda values: values["a"])


def test_a_json_file_is_built_from(tmp_path):
    path = tmp_path / "a.json"
    path.write_text('{"a": 1}')
    assert read_json(path, lambda values: values["a"]) == 1
