from drake_srg.simulation.metrics import Metrics as Metrics
from drake_srg.simulation.rig import Rig as Rig
from drake_srg.simulation.rig import bench_scenario as bench_scenario
from drake_srg.simulation.rig import shake as shake
from drake_srg.simulation.simulate import Result as Result
from drake_srg.simulation.simulate import Simulate as Simulate
from drake_srg.simulation.simulate import failure_time as failure_time
