"""Measurements and models of others that experiments compare with."""

from importlib import resources


def read_csv(name: str) -> list[str]:
    """Return the lines of a CSV file of this folder, without its comments.

    Raises:
        FileNotFoundError: If there is none of that name.
    """
    text = resources.files(__name__).joinpath(name).read_text(encoding="utf-8")
    return [line for line in text.splitlines() if not line.startswith("#")]
