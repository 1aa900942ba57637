"""2.5 kg between the fingertips, palm down and to the side, and the most they hold."""

from drake_srg.experiments.payload import payload_experiment
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult

CLAIM = 2.5  # kg, the SRG thesis's figure for an object between the fingertips
WIRE_FORCE = 125.0  # N, two fifths of what the servo gives


def run(track: Track) -> ExperimentResult:
    """Hold the claimed mass, then more."""
    title = f"Cylinder of 68 mm between the pads, {WIRE_FORCE:.0f} N at each wire"
    return payload_experiment(title, "pinch", CLAIM, WIRE_FORCE, track)
