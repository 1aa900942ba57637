"""What commands print: words for people, or one JSON object for scripts."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from typing import Any

# Pages of the documentation that explain a command, or an entry of a scenario.
COMMAND_PAGES = {
    "calibrate": "docs/calibration.md",
    "serve": "docs/bridges.md",
    "sweep": "docs/sweeps.md",
    "report": "docs/sweeps.md",
    "dataset": "docs/dataset.md",
    "train": "docs/training.md",
    "evaluate": "docs/training.md",
    "experiment": "docs/experiments.md",
    "export": "docs/export.md",
    "identify": "docs/gripper.md",
    "import": "docs/objects.md",
    "replay": "docs/replay.md",
    "twin": "docs/twin.md",
}
KEY_PAGES = {
    "camera_calibrations": "docs/calibration.md",
    "object": "docs/objects.md",
    "objects": "docs/objects.md",
    "sleeping": "docs/speed.md",
    "gripper": "docs/extending.md",
}

# Errors that need no explanation.
_PLAIN = (
    r"^stopped|cannot be (read|written)|already exists|is missing|`drake-srg doctor`"
)


class Output:
    """Standard output of a command.

    Args:
        json: Whether it is one JSON object and nothing else.
        quiet: Whether only errors and warnings are printed, and the JSON object.
        command: The command's name.

    Attributes:
        json: As given.
        progress: Whether to show progress, on standard error.
    """

    def __init__(self, json: bool, quiet: bool, command: str = ""):
        self.json, self.progress = json, not quiet
        self._words = not (json or quiet)
        self._command = command

    def say(self, *lines: object) -> None:
        """Print lines for people."""
        if self._words:
            for line in lines:
                print(line)

    def answer(self, values: Mapping[str, Any]) -> None:
        """Print the result for scripts; its values are JSON's, or paths."""
        if self.json:
            print(json.dumps(values, indent=2, default=str))

    def complain(self, message: str) -> None:
        """Print an error: a line on standard error, and JSON where it is wanted."""
        page = page_about(message, self._command)
        print(f"drake-srg: {message}{page and f' (see {page})'}", file=sys.stderr)
        self.answer({"error": message, "page": page or None})


def page_about(message: str, command: str) -> str:
    """Return the documentation page that explains an error, or an empty string."""
    if re.search(_PLAIN, message):
        return ""
    keys = "|".join(KEY_PAGES)
    if match := re.search(rf"(?:^|: |--set )({keys})[.=:]", message):
        return KEY_PAGES[match[1]]
    return COMMAND_PAGES.get(command, "")
