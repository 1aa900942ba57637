"""What README.md shows works as it stands there."""

import re
import shlex
from pathlib import Path

import pytest

from drake_srg.cli.main import make_parser

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
PAGES = README + (ROOT / "docs" / "bridges.md").read_text()


@pytest.mark.parametrize("code", re.findall(r"```python\n(.*?)```", README, re.DOTALL))
def test_python(code, capsys):
    variables: dict = {}
    exec(compile(code, "README.md", "exec"), variables)
    if "X_WO" in variables:  # the hand-built diagram holds the can up
        assert variables["X_WO"].translation()[2] == pytest.approx(0.13, abs=0.01)


def test_commands_parse():
    pattern = r"^drake-srg (?:run|serve) [a-z].*?(?=\s*#|$)"
    commands = re.findall(pattern, PAGES, re.MULTILINE)
    assert len(commands) > 7
    for command in commands:
        make_parser().parse_args(shlex.split(command)[1:])


def test_links_lead_somewhere():
    links = re.findall(r"\]\((?!http)([^)]+)\)", README)
    assert links
    for link in links:
        assert (ROOT / link).exists(), link
