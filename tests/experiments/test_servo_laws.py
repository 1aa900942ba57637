import numpy as np
import pytest

from drake_srg.experiments import servo_laws
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.servo_bench import Motion, simulate
from drake_srg.experiments.servo_laws import LAWS
from drake_srg.experiments.servo_motions import MOTIONS, SHIPPED

TESTED = ("pid", "printed", "literal")

pytestmark = pytest.mark.slow


def at_rest(time):
    return np.full_like(time, 0.5), 0.0 * time, 0.0 * time


@pytest.fixture(scope="module")
def result():
    with pytest.MonkeyPatch.context() as patch:
        laws = {name: LAWS[name] for name in TESTED}
        patch.setattr(servo_laws, "LAWS", laws)
        responses = {}
        draw = servo_laws.draw
        patch.setattr(servo_laws, "draw", lambda r: responses.update(r) or draw(r))
        result = servo_laws.run(quiet)
        swapped = {
            motion: {
                "pid": by_law["printed"],
                "printed": by_law["literal"],
                "literal": by_law["pid"],
            }
            for motion, by_law in responses.items()
        }
        _, joint = simulate(SHIPPED, Motion(at_rest, 0.3, duration=0.01))
        yield result, servo_laws.judge(swapped, joint)


def test_the_laws_behave_as_theory_predicts(result):
    assert result[0].passed, result[0].table()


def test_each_law_fails_the_criteria_of_another(result):
    failed = {row.name for row in result[1] if not row.passed}
    assert failed == set(TESTED)


def test_every_motion_has_a_table(result):
    assert set(result[0].tables) == set(MOTIONS)
    step = result[0].tables["step"]
    assert set(step) == {
        "time [s]",
        "reference [rad]",
        *(f"{law}: {what}" for law in TESTED for what in LABELS),
    }
    assert np.max(step["pid: PWM"]) == MOTIONS["step"].force_limit


LABELS = ("angle [rad]", "PWM")
