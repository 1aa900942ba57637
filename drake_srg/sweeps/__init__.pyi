from drake_srg.sweeps.info import read_sweep as read_sweep
from drake_srg.sweeps.rows import read_rows as read_rows
from drake_srg.sweeps.statistics import wilson_interval as wilson_interval
from drake_srg.sweeps.sweep import run_sweep as run_sweep
