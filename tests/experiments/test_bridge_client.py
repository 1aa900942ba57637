import pytest

from drake_srg.cli import main as cli
from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.bridge_client import ServedProcess


@pytest.mark.parametrize("experiment", ["bridge_load", "thesis_messages"])
def test_a_missing_roscore_is_reported_by_the_experiment(
    experiment, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("PATH", str(tmp_path))
    code = cli.main(["experiment", experiment, "--out", str(tmp_path / "out")])
    assert code == cli.BAD_INPUT
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith(f"drake-srg: {experiment}: needs a roscore")


@pytest.mark.slow
def test_a_station_that_cannot_be_served_reports_why():
    with pytest.raises(ScenarioError, match="!SrgTendonDriver"):
        ServedProcess("kitchen", "--no-record", "--servo", "pty")
