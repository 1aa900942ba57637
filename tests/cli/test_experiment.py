import json
import subprocess
import sys

import pytest

from drake_srg.cli import experiment as command
from drake_srg.cli.main import main
from experiments import find_experiments


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "code", "word"), [(2.0, 0, "ok"), (1.5, 1, "FAIL")])
def test_the_exit_code_says_whether_all_rows_pass(
    fake, limit, code, word, tmp_path, capsys
):
    fake(limit)
    out = tmp_path / "out"
    words = ["experiment", "fake_half", "--workers", "1", "--out", str(out)]
    assert main(words) == code
    printed = capsys.readouterr().out
    assert word in printed
    for name in ("result.json", "trials.csv", "fake_half.png"):
        assert str(out / name) in printed
    (row,) = json.loads((out / "result.json").read_text())
    assert row["pass"] == (code == 0)


def test_results_go_to_a_folder_named_after_the_experiment(fake, tmp_path, monkeypatch):
    fake(2.0)
    monkeypatch.chdir(tmp_path)
    assert main(["experiment", "fake_half", "--workers", "1"]) == 0
    assert (tmp_path / "out/experiments/fake_half/result.json").is_file()


def test_parameters_and_quick_of_the_command_line_count(fake, tmp_path, capsys):
    ran = fake(4.0)
    words = ["experiment", "fake_third", "--workers", "1", "--out", str(tmp_path)]
    words += ["--set", "count=5", "--set", "lengths=[6, 9]", "--quick", "--json"]
    assert main(words) == 0
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    assert (row["name"], row["quantity"], row["measured"]) == ("third", "of 5", 2.0)
    assert ran() == [6.0]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fake_half", "--set", "cuont=3"], "did you mean 'count'?"),
        (["fake_hafl"], "did you mean 'fake_half'?"),
    ],
)
def test_bad_input_is_one_line(fake, words, message, tmp_path, capsys):
    fake(2.0)
    out = tmp_path / "out"
    assert main(["experiment", *words, "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert not out.exists()


def test_help_after_a_name_shows_its_parameters(fake, capsys):
    fake(2.0)
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", "fake_third", "--help"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out.splitlines() == [
        "fake_third: A third.",
        "",
        "parameters (--set KEY=VALUE):",
        "  count=3  Number of times, in whole numbers.",
        "  lengths=[2.0, 4.0]  To divide [m].",
        "  kind=third  The part of a length to return.",
    ]


def test_help_without_a_name_shows_the_options(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", "--help"])
    assert stopped.value.code == 0
    assert "--set KEY=VALUE" in capsys.readouterr().out


def test_an_interrupted_experiment_keeps_its_trials(fake, tmp_path, capsys):
    fake(largest=3.0)
    out = tmp_path / "new" / "out"
    words = ["experiment", "fake_half", "--workers", "1", "--out", str(out)]
    assert main(words) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "drake-srg: stopped"
    assert [path.name for path in out.iterdir()] == ["trials.jsonl"]


def test_an_unwritable_folder_is_bad_input(fake, tmp_path, capsys):
    fake(2.0)
    (tmp_path / "file").write_text("in the way")
    out = tmp_path / "file" / "out"
    assert main(["experiment", "fake_half", "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--out {out}: cannot be written" in line


@pytest.mark.parametrize("arguments", [[], ["fake_half", "--list"]])
def test_either_a_name_or_the_list_is_needed(arguments, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", *arguments])
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--list" in line


def test_a_wheel_says_where_experiments_are(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(command, "_CHECKOUT", tmp_path)
    for words in (["--list"], ["soft"]):
        assert main(["experiment", *words]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "experiments are in the repository" in line


def test_the_list_appears_without_importing_drake():
    code = """
import sys
from drake_srg.cli.main import main
main(["experiment", "--list"])
sys.exit(any(m in sys.modules for m in ("pydrake", "matplotlib", "numpy")))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    names = [line.split()[0] for line in done.stdout.splitlines()]
    assert names == list(find_experiments())
