from drake_srg.lifetime import LeafSystem as LeafSystem
from drake_srg.scenario import Scenario as Scenario
from drake_srg.scenario import load_scenario as load_scenario
from drake_srg.simulation import Simulate as Simulate
from drake_srg.simulation.rig import Rig as Rig
from drake_srg.station import MakeCell as MakeCell
from drake_srg.station import MakeStation as MakeStation
from drake_srg.types import Blob as Blob
from drake_srg.types import Failure as Failure
from drake_srg.types import Mode as Mode

__version__: str
