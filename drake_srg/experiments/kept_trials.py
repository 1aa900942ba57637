"""A file of finished trials, so that an experiment that was cut off goes on."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from drake_srg.common.exceptions import ScenarioError


class KeptTrials:
    """Runs trials once and remembers their results, one line of JSON each.

    Delete the file after a change of the code: it does not know of that.

    Args:
        path: The file; "" keeps nothing.

    Raises:
        ScenarioError: If the file cannot be read.
    """

    def __init__(self, path: str) -> None:
        self._path = Path(path) if path else None
        self._made: dict[str, Any] = {}
        if self._path is not None and self._path.exists():
            try:
                lines = self._path.read_text(encoding="utf-8").splitlines()
            except (OSError, UnicodeDecodeError) as error:
                raise ScenarioError(f"keep: {path}: cannot be read: {error}") from None
            for line in lines:
                # The last line may be incomplete; its trial then runs again.
                with contextlib.suppress(ValueError, KeyError, TypeError):
                    entry = json.loads(line)
                    self._made[entry["trial"]] = entry["result"]

    def __call__(
        self, trial: str, run: Callable[[], Mapping[str, Any]]
    ) -> Mapping[str, Any]:
        """Return the result of a trial; runs it unless it has run before.

        Args:
            trial: Its name.
            run: Returns its result as numbers, text, lists and dictionaries.

        Raises:
            ScenarioError: If the file cannot be written.
        """
        if trial not in self._made:
            self._made[trial] = run()
            if self._path is not None:
                line = json.dumps({"trial": trial, "result": self._made[trial]})
                try:
                    with self._path.open("a", encoding="utf-8") as file:
                        # On a line of its own, whatever was cut off before.
                        file.write(f"\n{line}\n")
                except OSError as error:
                    raise ScenarioError(
                        f"keep: {self._path}: cannot be written: {error.strerror}"
                    ) from None
        result: Mapping[str, Any] = self._made[trial]
        return result
