"""The committed figures in docs: read them, and accept new ones."""

from __future__ import annotations

import dataclasses as dc
import io
import json
from collections.abc import Mapping
from pathlib import Path

from PIL import Image

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.row import Row
from drake_srg.sweeps.files import write_file
from reproduce.page import update
from reproduce.stamps import RESULT, Stamp, read_stamps, write_stamps

LARGEST = 100_000  # file size of a figure on the page [bytes]


def read_rows(result: Path) -> list[Row]:
    """Return the rows of a result.json.

    Raises:
        OSError: If it cannot be read.
        ScenarioError: If its content is not a result.
    """
    try:
        return [Row.from_dict(v) for v in json.loads(result.read_text("utf-8"))]
    except (ValueError, KeyError, TypeError) as error:
        raise ScenarioError(f"{result}: invalid content: {error!r}") from None


@dc.dataclass(frozen=True)
class Committed:
    """The committed figures.

    Attributes:
        docs: The folder with experiments.md.
    """

    docs: Path

    @property
    def page(self) -> Path:
        """The page of all experiments."""
        return self.docs / "experiments.md"

    @property
    def figures(self) -> Path:
        """The folder with rows and pictures."""
        return self.docs / "experiments"

    def rows(self, name: str) -> list[Row] | None:
        """Return the rows of an experiment; None if there is no committed result.

        Raises:
            ScenarioError: If the file is not a result.
        """
        path = self.figures / f"{name}.json"
        return read_rows(path) if path.exists() else None

    def stamps(self) -> dict[str, Stamp]:
        """Return the stamps of the committed results by experiment."""
        return read_stamps(self.figures / "stamps.json")

    def render(self, descriptions: Mapping[str, str]) -> str:
        """Return the page as the committed results give it.

        Args:
            descriptions: Of the experiments, by name. Those without a committed result
                stay as they are.

        Raises:
            ScenarioError: If a section lacks its markers, or a file is not a result.
        """
        page, stamps = self.page.read_text(encoding="utf-8"), self.stamps()
        for name, description in descriptions.items():
            rows = self.rows(name)
            if rows is not None and name in stamps:
                page = update(page, name, description, rows, stamps[name])
        return page

    def accept(
        self, made: Mapping[str, Stamp], out: Path, descriptions: Mapping[str, str]
    ) -> None:
        """Put new results into the docs and make the page from them.

        Args:
            made: Stamps of the new results by experiment.
            out: The folder with a folder of results for each of them.
            descriptions: Of all experiments, by name.
        """
        for name in made:
            result = (out / name / RESULT).read_bytes()
            with Image.open(out / name / f"{name}.png") as figure:
                picture = shrink(figure)
            write_file(self.figures / f"{name}.json", result)
            write_file(self.figures / f"{name}.png", picture)
        write_stamps(self.figures / "stamps.json", {**self.stamps(), **made})
        write_file(self.page, self.render(descriptions).encode())


def shrink(figure: Image.Image) -> bytes:
    """Return a figure as PNG with as many colours as `LARGEST` allows."""
    for colors in (256, 128, 64):
        file = io.BytesIO()
        few = figure.convert("RGB").quantize(colors, dither=Image.Dither.NONE)
        few.save(file, "PNG", optimize=True)
        if file.tell() < LARGEST:
            break
    return file.getvalue()
