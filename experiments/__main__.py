"""The command `python -m experiments`.

`python -m experiments NAME ...` is `drake-srg experiment NAME ...`;
`python -m experiments all ...` reruns many and compares them with the committed rows.
"""

import sys

from drake_srg.cli.main import main
from experiments.runner.rerun import main as rerun

if sys.argv[1:2] == ["all"]:
    sys.exit(rerun(sys.argv[2:]))
sys.exit(main(["experiment", *sys.argv[1:]]))
