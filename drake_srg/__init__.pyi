from drake_srg.common.exceptions import ScenarioError as ScenarioError
from drake_srg.lifetime import LeafSystem as LeafSystem
from drake_srg.scenario.load import load_scenario as load_scenario
from drake_srg.scenario.schema import Scenario as Scenario
from drake_srg.simulation.rig import Rig as Rig
from drake_srg.simulation.simulate import Simulate as Simulate
from drake_srg.station.cell import MakeCell as MakeCell
from drake_srg.station.station import MakeStation as MakeStation
from drake_srg.types import Blob as Blob
from drake_srg.types import Failure as Failure
from drake_srg.types import Mode as Mode

__version__: str
