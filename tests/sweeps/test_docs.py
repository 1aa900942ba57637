"""What docs/sweeps.md and docs/dataset.md show exists."""

import re
import shlex
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from drake_srg.cli.main import make_parser
from drake_srg.sweeps.rows import TIMING_COLUMNS, row_path, write_row
from drake_srg.sweeps.trial import empty_row

DOCS = Path(__file__).parents[2] / "docs"
PAGES = {name: (DOCS / name).read_text() for name in ("sweeps.md", "dataset.md")}


@pytest.mark.parametrize("page", PAGES)
def test_commands_parse(page):
    pattern = r"^(?:time )?drake-srg ((?:sweep|report|dataset) [a-z].*?)(?=\s+#|$)"
    commands = re.findall(pattern, PAGES[page], re.MULTILINE)
    assert len(commands) >= 2
    for command in commands:
        make_parser().parse_args(shlex.split(command))


@pytest.mark.parametrize("page", PAGES)
def test_links_resolve(page):
    links = re.findall(r"\]\((?!http)([^)#]*)(?:#[^)]*)?\)", PAGES[page])
    assert links
    assert [link for link in links if not (DOCS / link).exists()] == []


def test_the_example_reads_rows(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", PAGES["sweeps.md"], re.DOTALL)
    write_row(row_path(tmp_path, 0), empty_row(7, 0, "no such joint"))
    table = pq.read_table(row_path(tmp_path, 0))
    shown = []
    variables = {"print": shown.append}
    exec(
        code.replace("out/kitchen/trials.parquet", str(row_path(tmp_path, 0))),
        variables,
    )
    assert variables["rows"].equals(table)
    assert shown[0].to_pylist() == [
        {"seed": 7, "failure": "error", "message": "no such joint"}
    ]


def test_the_columns_that_differ_between_runs_are_named():
    assert [
        name for name in TIMING_COLUMNS if f"`{name}`" not in PAGES["sweeps.md"]
    ] == []
