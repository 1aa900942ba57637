"""5 kg in the fingers' embrace, palm down and to the side, and the most they hold."""

from drake_srg.experiments.payload import payload_experiment
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult

CLAIM = 5.0  # kg, the SRG thesis's figure for an enveloped object
WIRE_FORCE = 200.0  # N, two thirds of what the servo gives


def run(track: Track) -> ExperimentResult:
    """Hold the claimed mass, then more."""
    title = f"Wrapped cylinder of 68 mm, {WIRE_FORCE:.0f} N at each wire"
    return payload_experiment(title, "wrap", CLAIM, WIRE_FORCE, track)
