import json
from pathlib import Path

import pytest

from drake_srg.cli.main import main
from drake_srg.cli.output import COMMAND_PAGES, KEY_PAGES, Output, page_about

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("json_", "quiet", "printed"),
    [
        (False, False, "words\n"),
        (False, True, ""),
        (True, False, '{\n  "path": "a/b"\n}\n'),
        (True, True, '{\n  "path": "a/b"\n}\n'),
    ],
)
def test_words_are_for_people_and_json_for_scripts(json_, quiet, printed, capsys):
    output = Output(json_, quiet)
    output.say("words")
    output.answer({"path": Path("a/b")})
    assert capsys.readouterr().out == printed
    assert output.progress is not quiet


@pytest.mark.parametrize("page", sorted({*COMMAND_PAGES.values(), *KEY_PAGES.values()}))
def test_the_pages_are_there(page):
    assert (ROOT / page).is_file()


@pytest.mark.parametrize(
    ("message", "command", "page"),
    [
        ("kitchen: objects.can.mass: must be greater than 0", "run", "docs/objects.md"),
        ("--set object.mas=1: unknown", "run", "docs/objects.md"),
        ("kitchen: sleeping.after: must be positive", "sweep", "docs/speed.md"),
        ("--trials 0: must be at least 1", "sweep", "docs/sweeps.md"),
        ("--out x: cannot be written: No space left on device", "sweep", ""),
        ("stopped", "sweep", ""),
        ("unknown scenario 'kitchn'", "run", ""),
    ],
)
def test_errors_name_the_page_that_explains_them(message, command, page):
    assert page_about(message, command) == page


def test_an_error_is_a_line_and_for_scripts_an_object(tmp_path, capsys):
    folder = tmp_path / "nothing"
    assert main(["replay", str(folder), "--json", "--quiet"]) == 2
    output = capsys.readouterr()
    answer = json.loads(output.out)
    assert answer["page"] == "docs/replay.md"
    assert output.err == f"drake-srg: {answer['error']} (see docs/replay.md)\n"


@pytest.mark.parametrize("arguments", [["list", "--json"], ["experiment", "--list"]])
def test_lists_are_for_scripts_too(arguments, capsys):
    assert main([*arguments, "--json"]) == 0
    lists = json.loads(capsys.readouterr().out)
    assert all(isinstance(names, dict) for names in lists.values())


def test_a_bad_command_line_is_an_object_too(capsys):
    with pytest.raises(SystemExit):
        main(["run", "--json"])
    assert "SCENARIO" in json.loads(capsys.readouterr().out)["error"]
