from drake_srg.common.exceptions import ScenarioError as ScenarioError
from drake_srg.common.joint_errors import JointErrorsConfig as JointErrorsConfig
from drake_srg.common.srg_geometry import SRG as SRG
from drake_srg.common.systems import MakeSimulator as MakeSimulator
from drake_srg.common.systems import export_outputs as export_outputs
from drake_srg.common.systems import input_ports as input_ports
from drake_srg.common.systems import output_ports as output_ports
from drake_srg.common.systems import value_or_none as value_or_none
