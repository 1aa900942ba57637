import json
import subprocess
import sys

import pytest
from experiments.fake_experiment import TWO

from drake_srg.cli.main import main
from drake_srg.experiments import registry


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "code", "word"), [(2.0, 0, "ok"), (1.5, 1, "FAIL")])
def test_the_exit_code_says_whether_all_rows_pass(
    fake, limit, code, word, tmp_path, capsys
):
    fake(limit)
    out = tmp_path / "out"
    assert main(["experiment", "fake_one", "--out", str(out)]) == code
    printed = capsys.readouterr().out
    assert word in printed
    for name in ("result.json", "parts.csv", "fake_one.png"):
        assert str(out / name) in printed
        assert (out / name).is_file()
    (row,) = json.loads((out / "result.json").read_text())
    assert row["pass"] == (code == 0)
    assert row["measured"] == 2.0


def test_results_go_to_a_folder_named_after_the_experiment(fake, tmp_path, monkeypatch):
    fake(2.0)
    monkeypatch.chdir(tmp_path)
    assert main(["experiment", "fake_one"]) == 0
    assert (tmp_path / "out/experiments/fake_one/result.json").is_file()


@pytest.mark.slow
def test_parameters_of_the_command_line_override_those_of_the_name(fake, tmp_path):
    fake(4.0, declared=TWO)
    command = ["experiment", "fake_third", "--out", str(tmp_path)]
    command += ["--set", "count=5", "--set", "lengths=[6, 9]"]
    assert main(command) == 0
    (row,) = json.loads((tmp_path / "result.json").read_text())
    assert (row["name"], row["quantity"]) == ("third", "of 5")
    assert row["measured"] == 3.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("cuont=3", "unknown key 'cuont' (did you mean 'count'? allowed: count, kind"),
        ("count", "--set count: must be KEY=VALUE"),
        ("count=many", "count: must be a number"),
        ("count=1.5", "count: must be a whole number"),
        ("count=0", "count: must be greater than 0, got 0"),
        ("count=[1", "--set count: not valid YAML"),
        ("lengths=2.0", "lengths: must be a list"),
        ("lengths=[]", "lengths: needs at least one entry"),
        ("lengths=[1.0, -2]", "lengths: must be greater than 0, got -2"),
        ("kind=tenth", "kind: must be one of half, third; got 'tenth'"),
    ],
)
def test_a_bad_parameter_is_one_line(fake, setting, message, tmp_path, capsys):
    fake(2.0)
    out = tmp_path / "out"
    command = ["experiment", "fake_one", "--out", str(out), "--set", setting]
    assert main(command) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert not out.exists()


def test_help_after_a_name_shows_its_parameters(fake, capsys):
    fake(2.0, declared=TWO)
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", "fake_third", "--help"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out.splitlines() == [
        "fake_third: A third.",
        "",
        "parameters (--set KEY=VALUE):",
        "  count=3  How often, in whole numbers.",
        "  lengths=[2.0, 4.0]  To divide [m].",
        "  kind=third  The part of a length to return.",
    ]


def test_help_without_a_name_shows_the_options(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", "--help"])
    assert stopped.value.code == 0
    printed = capsys.readouterr().out
    assert "NAME" in printed
    assert "--set KEY=VALUE" in printed


def test_help_on_an_unknown_experiment_is_bad_input(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", "payload_warp", "--help"])
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "did you mean 'payload_wrap'?" in line


@pytest.mark.slow
def test_an_unknown_name_is_answered_with_the_list(fake, tmp_path, capsys):
    fake(2.0)
    out = tmp_path / "out"
    assert main(["experiment", "fake_on", "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "did you mean 'fake_one'?" in line
    for name in (*registry.list_experiments(), *registry.list_measurements()):
        assert name in line
    assert not out.exists()


def test_an_interrupted_experiment_leaves_nothing_behind(fake, tmp_path, capsys):
    fake(2.0, stop=True)
    out = tmp_path / "new" / "out"
    assert main(["experiment", "fake_one", "--out", str(out)]) == 2
    assert capsys.readouterr().err == "drake-srg: stopped\n"
    assert not out.parent.exists()


def test_an_unwritable_folder_is_bad_input(fake, tmp_path, capsys):
    fake(2.0)
    (tmp_path / "file").write_text("in the way")
    out = tmp_path / "file" / "out"
    assert main(["experiment", "fake_one", "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--out {out}: cannot be written" in line


@pytest.mark.parametrize("arguments", [[], ["fake_one", "--list"]])
def test_either_a_name_or_the_list_is_needed(arguments, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", *arguments])
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--list" in line


@pytest.mark.parametrize("arguments", [["--list"], ["payload_wrap", "--help"]])
def test_list_and_help_appear_without_importing_drake(arguments):
    code = f"""
import sys
from drake_srg.cli.main import main
try:
    main(["experiment", *{arguments}])
except SystemExit:
    pass
sys.exit(any(m in sys.modules for m in ("pydrake", "matplotlib", "numpy")))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    own, _, for_maintainers = done.stdout.partition("\n\n")
    first = [line.split()[0] for line in own.splitlines()]
    if arguments == ["--list"]:
        assert first == list(registry.list_experiments())
        heading, *lines = for_maintainers.splitlines()
        assert heading == "For maintainers, in a checkout only (tools/measure):"
        assert tuple(line.split()[0] for line in lines) == registry.MEASUREMENTS
    else:
        assert first == ["payload_wrap:"]
