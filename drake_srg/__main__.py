"""Makes `python -m drake_srg` the command `drake-srg`."""

import sys

from drake_srg.cli.main import main

sys.exit(main())
