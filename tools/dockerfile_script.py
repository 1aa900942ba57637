"""Print the RUN and ENV lines of the Dockerfile as a shell script.

The script does in a bare Debian what `docker build` does in a container:
`python3 tools/dockerfile_script.py | sh -e`. It needs nothing but Python.
"""

import re
from pathlib import Path

DOCKERFILE = Path(__file__).parents[1] / "Dockerfile"


def to_script(dockerfile: str) -> str:
    """Return the commands of a Dockerfile that do not need Docker."""
    lines = re.sub(r"\\\n\s*", "", dockerfile).splitlines()
    found = [line.partition(" ") for line in lines]
    words = {"RUN": "", "ENV": "export "}
    return "".join(
        f"{words[word]}{rest.strip()}\n" for word, _, rest in found if word in words
    )


if __name__ == "__main__":
    print(to_script(DOCKERFILE.read_text("utf-8")), end="")
