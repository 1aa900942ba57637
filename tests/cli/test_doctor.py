import importlib.util
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from helpers import LACKS_DDS

from drake_srg.cli import doctor
from drake_srg.cli.main import main
from drake_srg.common.installing import LIBRARIES, pip_install, this_package

SCRIPT = Path(__file__).parents[2] / "tools" / "install_system_libraries.sh"


def by_name(checks):
    return {check.name: check for check in checks}


@pytest.mark.slow
def test_this_machine_passes_every_required_check():
    checks = doctor.examine_machine()
    assert [check.name for check in checks] == [
        "python",
        "drake",
        "packages",
        "rendering",
        "video",
        "rosbags",
        "plots",
        "solvers",
        "models",
        "sweeps",
        "training",
        "ray",
        "ros2",
        "import",
        "graphviz",
    ]
    assert [check for check in checks if not (check.ok or check.optional)] == []
    assert all(check.detail and check.ok != bool(check.fix) for check in checks)


@pytest.mark.slow
def test_the_doctor_works_without_drake(tmp_path):
    (tmp_path / "pydrake.py").write_text("raise ImportError('no pydrake here')")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); "
        "from drake_srg.cli.main import main; sys.exit(main(['doctor']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (1, "")
    lines = done.stdout.splitlines()
    (line,) = [i for i, line in enumerate(lines) if line.startswith("FAIL    drake ")]
    assert "no pydrake here" in lines[line]
    assert "-m pip install 'drake>=" in lines[line + 1]


def test_a_crash_fails_the_check_only():
    crash = "import os; os.abort()"
    check = doctor.check("x", lambda: doctor.run_elsewhere(crash), "reboot")
    assert check == doctor.Check("x", False, "crashed by SIGABRT", "reboot")


def test_the_last_error_of_a_check_is_reported():
    code = "import nothing_of_this_name"
    check = doctor.check("x", lambda: doctor.run_elsewhere(code), "")
    assert check.detail == (
        "ModuleNotFoundError: No module named 'nothing_of_this_name'"
    )


def test_a_check_that_never_ends_fails():
    code = "import time; time.sleep(20)"
    check = doctor.check("x", lambda: doctor.run_elsewhere(code, patience=0.1), "")
    assert check == doctor.Check("x", False, "timed out after 0.1 s")


def test_a_long_message_is_one_line():
    def fail():
        raise ImportError("no\n  pydrake\nhere")

    assert doctor.check("x", fail, "").detail == "no pydrake here"


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("av", "video"),
        ("cv2", "packages"),
        ("cyclonedds.domain", "ros2"),
        ("joblib", "sweeps"),
        ("matplotlib.figure", "plots"),
        ("rosbags.rosbag2", "rosbags"),
        ("ruckig", "packages"),
        ("toppra", "packages"),
    ],
)
def test_a_missing_package_is_named_with_the_command_that_installs_it(
    monkeypatch, module, name
):
    monkeypatch.setattr(doctor, "run_elsewhere", lambda code: "")
    monkeypatch.setattr(shutil, "which", lambda name, **_: "/dot")
    missing = {"ros2"} if LACKS_DDS else set()
    missing |= set() if importlib.util.find_spec("torch") else {"training"}
    monkeypatch.setitem(sys.modules, module, None)
    checks = by_name(doctor.examine_machine())
    failed = {check.name for check in checks.values() if not check.ok}
    assert failed == {name} | missing
    extra = {"ros2": "ros2", "sweeps": "sweep"}.get(name, "")
    assert checks[name].fix == pip_install(*this_package(extra))


def test_graphviz_is_optional(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "run_elsewhere", lambda code: "")
    monkeypatch.setattr(shutil, "which", lambda name, **_: None)
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (at,) = [i for i, line in enumerate(lines) if line.startswith("missing graphviz ")]
    assert "only `drake-srg diagram` needs it" in lines[at]
    assert lines[at + 1].endswith("apt-get install -y --no-install-recommends graphviz")


def test_missing_libraries_are_reported_with_their_packages(monkeypatch):
    def fail(code):
        if "MakeRenderEngineVtk" in code:
            raise RuntimeError("crashed by SIGSEGV")
        raise RuntimeError("ImportError: libglib-2.0.so.0: cannot open shared object")

    monkeypatch.setattr(doctor, "run_elsewhere", fail)
    checks = by_name(doctor.examine_machine())
    assert checks["rendering"].fix.endswith(" libegl1 libgl1")
    assert checks["drake"].fix.endswith(" libegl1 libgl1")


def test_the_doctor_wants_the_versions_of_the_project():
    text = (SCRIPT.parents[1] / "pyproject.toml").read_text("utf-8")
    project = tomllib.loads(text)["project"]
    assert project["requires-python"] == f">={doctor.OLDEST_PYTHON}"
    assert f"drake>={doctor.OLDEST_DRAKE}" in project["dependencies"]


def test_old_versions_fail():
    doctor.require_version("drake", "1.51.1", "1.51.1")
    doctor.require_version("drake", "1.100", "1.51.1")
    with pytest.raises(RuntimeError, match=r"drake 1\.9\.9 is older than 1\.51\.1"):
        doctor.require_version("drake", "1.9.9", "1.51.1")


def test_script_and_doctor_name_the_same_packages():
    packages = re.findall(r"^\S+\.so\S*:(\S+)$", SCRIPT.read_text(), re.MULTILINE)
    assert tuple(packages) == tuple(LIBRARIES.values())


def fake_machine(folder, libraries, user):
    """A PATH where ldconfig lists `libraries` and id says `user`."""
    commands = {
        "ldconfig": "".join(f"echo '\t{x} (libc6) => /lib/{x}'\n" for x in libraries),
        "id": f"echo {user}",
        "apt-get": 'echo "apt-get $*"',
    }
    for name, body in commands.items():
        (folder / name).write_text(f"#!/bin/sh\n{body}\n")
        (folder / name).chmod(0o755)
    return {"PATH": str(folder)}


@pytest.mark.skipif(not shutil.which("sh"), reason="a POSIX shell runs the script")
@pytest.mark.parametrize(
    ("libraries", "user", "code", "out", "err"),
    [
        (["libglib-2.0.so.0", "libEGL.so.1", "libGL.so.1"], 1000, 0, "", ""),
        (
            ["libglib-2.0.so.0"],
            0,
            0,
            "apt-get update\n"
            "apt-get -o DPkg::Lock::Timeout=600 install -y --no-install-recommends "
            "libegl1 libgl1\n",
            "",
        ),
        (
            ["libEGL.so.1", "libGL.so.1", "libglib-2.0.so.0.1"],
            1000,
            1,
            "",
            "sudo apt-get update && sudo apt-get install -y "
            "--no-install-recommends libglib2.0-0\n",
        ),
    ],
    ids=["nothing_missing", "root_installs", "user_gets_the_command"],
)
def test_the_script_installs_missing_libraries_or_prints_how(
    tmp_path, libraries, user, code, out, err
):
    done = subprocess.run(
        [shutil.which("sh"), str(SCRIPT)],
        env=fake_machine(tmp_path, libraries, user),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (code, out)
    assert done.stderr.endswith(err)
    assert bool(done.stderr) == bool(err)
