"""Makes the packages in tools/ importable: `measure`."""

import sys
from pathlib import Path

# At the end, so that `models` stays tests/models.
sys.path.append(str(Path(__file__).parents[2] / "tools"))
