"""The command `python -m experiments`.

`python -m experiments NAME ...` is `drake-srg experiment NAME ...`;
`python -m experiments all ...` reruns many and compares them with the committed rows;
`python -m experiments pages` fills the values into README.md and docs/figures.md.
"""

import sys

from drake_srg.cli.main import main
from experiments.runner.page import write_quoting_pages
from experiments.runner.rerun import main as rerun

if sys.argv[1:2] == ["all"]:
    sys.exit(rerun(sys.argv[2:]))
if sys.argv[1:] == ["pages"]:
    write_quoting_pages()
    sys.exit()
sys.exit(main(["experiment", *sys.argv[1:]]))
