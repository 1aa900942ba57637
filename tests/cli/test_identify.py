import dataclasses as dc
import json

import numpy as np
import pytest

from drake_srg.cli.main import main
from drake_srg.robot.identify import fits
from drake_srg.robot.identify.fits import (
    HEAT_PARAMETERS,
    PRESS_PARAMETERS,
    Motor,
    predict_stops,
)
from drake_srg.robot.identify.least_squares import fit
from drake_srg.scenario import load_scenario

MOTOR = Motor(stall_current=3.0, dead_band=0.1, most=0.96)


@pytest.fixture
def quick(monkeypatch):
    """Instead of a fit, the priors."""

    def identify(rows):
        row = rows[0]
        made = {
            name: fit(parameters, lambda values: np.zeros((1, 1)))
            for name, parameters in (
                ("motor", fits._MOTOR),
                ("press", PRESS_PARAMETERS),
                ("heat", HEAT_PARAMETERS),
            )
        }
        stop = predict_stops([row], 2811.0, MOTOR, made["press"].values)[0]
        error = fits.Error(row.label, "stop", "counts", 2834.0, stop, stop, 6.0)
        errors = [
            error,
            fits.Error(row.label, "current", "mA", 273.0, 270.0, 260.0, 27.0),
            fits.Error("heating 15 %", "heating", "s", 335.0, 330.0, 300.0, 33.5),
        ]
        return fits.Identification(MOTOR, 2811.0, made, errors)

    monkeypatch.setattr(fits, "identify", identify)


def test_it_writes_a_scenario_that_runs(quick, tmp_path, capsys):
    out = tmp_path / "mine.yaml"
    assert main(["identify", "vendor", "-o", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "stall_current" in printed
    assert "cannot determine" in printed
    drive = load_scenario(out).gripper.drive
    assert drive.dead_band == pytest.approx(0.05)
    assert drive.friction.gear_load == pytest.approx(0.4, rel=0.01)


def test_the_base_may_be_a_file_in_another_folder(quick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    base = tmp_path / "bench.yaml"
    base.write_text("base: gripper_bench\nrandom_seed: 7\n")
    (tmp_path / "made").mkdir()
    words = ["identify", "vendor", "--base", "bench.yaml", "-o"]
    assert main([*words, "made/mine.yaml"]) == 0
    assert load_scenario("made/mine.yaml").random_seed == 7
    assert main([*words, "./bench.yaml"]) == 2
    assert "identify" not in base.read_text()


def test_values_that_no_scenario_takes_are_not_written(
    quick, tmp_path, capsys, monkeypatch
):
    out = tmp_path / "mine.yaml"
    monkeypatch.setattr(fits, "_MOTOR", [dc.replace(p, prior=0.6) for p in fits._MOTOR])
    assert main(["identify", "vendor", "-o", str(out)]) == 2
    error = capsys.readouterr().err
    assert "vendor: gripper.drive.dead_band: must be" in error
    assert not list(tmp_path.iterdir())


def test_json_has_parameters_with_intervals(quick, tmp_path, capsys):
    out = tmp_path / "mine.yaml"
    assert main(["identify", "vendor", "-o", str(out), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    low, high = answer["parameters"]["stiffness"]["interval"]
    assert low < answer["parameters"]["stiffness"]["value"] < high
    assert not answer["parameters"]["stiffness"]["told"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.csv"], "none.csv: cannot be read: No such file or directory"),
        (["bad.csv"], "bad.csv: missing column load"),
        (["vendor", "--base", "kitchen"], "gripper: needs !SrgTendonDriver"),
        (["vendor", "--base", "nowhere"], "nowhere"),
        (["vendor", "--record", "/dev/null"], "--record: needs a file to write"),
        (["bad.csv", "--record", "/dev/null"], "bad.csv: already exists; choose"),
        (["my.csv", "--record", "none"], "--record none: port: must be tcp:HOST:PORT"),
        (["my.csv", "--record", "/none"], "--record /none: [Errno 2] No such file"),
        (["my.csv", "--record", "/dev/null", "--id", "300"], "--id: must be 0 to 252"),
    ],
)
def test_bad_input_gets_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.csv").write_text("test,setpoint_pct\nposition,20\n")
    assert main(["identify", *arguments]) == 2
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["bad.csv"]
