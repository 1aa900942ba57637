"""Where the fast scenario's fingers bring a cylinder, and the frames for that."""

from drake_srg.experiments.grasp_calibration import calibrate
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult

SCENARIO = "assistive_arm_fast"


def run(track: Track) -> ExperimentResult:
    """Measure as drawn, correct the tip, measure, correct the release, measure."""
    return calibrate(SCENARIO, track)
