import subprocess

import pytest

from drake_srg.cli import learn
from drake_srg.cli.main import SHELLS, main
from drake_srg.learning.envs import ENVIRONMENTS
from drake_srg.learning.rules import BUILT_IN


def complete(folder, words):
    """Complete the last of some words in bash."""
    return subprocess.run(
        ["bash", "--norc", "-c", BASH, "bash", str(folder / "completion"), *words],
        capture_output=True,
        text=True,
        check=True,
        cwd=folder,
    ).stdout.split()


# Reads the script, and calls the function that it registers as bash does on a tab.
BASH = """
source "$1"
shift
COMP_WORDS=("$@")
COMP_CWORD=$(($# - 1))
function=$(complete -p drake-srg | sed 's/.*-F \\([^ ]*\\).*/\\1/')
$function drake-srg "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["exp"], {"experiment", "export"}),
        (["run", "thesis_kitchen_t"], {"thesis_kitchen_tendon"}),
        (["export", "kitchen", "--m"], {"--mjcf"}),
        (["replay", "re"], {"recorded"}),
        (["completion", "f"], {"fish"}),
        (["experiment", "grip_l"], {"grip_ladder"}),
        (["evaluate", "grasp_o"], {"grasp_one_shot"}),
        (["evaluate", "to"], {"touch"}),
        (["evaluate", "pick", "KitchenPickP"], {"KitchenPickPlace"}),
        (["train", "Gra"], {"GraspOneShot"}),
    ],
)
def test_bash_completes(tmp_path, capsys, words, found):
    assert main(["completion", "bash"]) == 0
    (tmp_path / "completion").write_text(capsys.readouterr().out)
    (tmp_path / "recorded").mkdir()
    assert set(complete(tmp_path, ["drake-srg", *words])) == found


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_knows_commands_and_scenarios(capsys, shell):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    for word in ("export", "mjcf", "kitchen_tendon"):
        assert word in script


def test_environments_and_rules_are_named_as_they_are():
    assert [f"{name}-v0" for name in learn.ENVIRONMENTS] == list(ENVIRONMENTS)
    assert set(learn.RULES) == set(BUILT_IN)
