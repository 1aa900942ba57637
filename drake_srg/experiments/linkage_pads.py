"""Models of the linkage gripper with pads of other friction and hardness."""

from __future__ import annotations

import dataclasses as dc
import re
from pathlib import Path

from drake_srg.parsing import models_path

# The models that the shapes, and the materials, are taken from.
MODELS = {"flat": "linkage_gripper_bare", "curved": "linkage_gripper_fast"}
MATERIALS = {"hard": "linkage_gripper_bare", "rubber": "linkage_gripper_fast"}
_PAD = re.compile(
    r'(<collision name="(master|slave)_pad.*?<drake:proximity_properties>)(.*?)'
    r"(</drake:proximity_properties>)",
    re.DOTALL,
)
_FRICTION = re.compile(r"(<drake:mu_(?:dynamic|static)>)[^<]*")


@dc.dataclass(frozen=True)
class Pads:
    """The pads of a gripper.

    Attributes:
        shape: A key of `MODELS`.
        material: A key of `MATERIALS`.
        friction: Between pads and object.
    """

    shape: str
    material: str
    friction: float

    def __str__(self) -> str:
        return f"{self.shape}, {self.material}, friction {self.friction:g}"


def write_model(pads: Pads, object_friction: float, path: Path) -> None:
    """Write the SDF of a gripper with such pads.

    Args:
        pads: The pads.
        object_friction: The object's own friction. The pads get the friction with which
            Drake's rule, the harmonic mean of both, gives `pads.friction`.
        path: Of the SDF.

    Raises:
        ValueError: If the rule cannot give `pads.friction`, because that is twice
            `object_friction` or more.
    """
    rest = 2.0 * object_friction - pads.friction
    if rest <= 0.0:
        raise ValueError(
            f"friction must be less than {2.0 * object_friction:g}, twice the object's,"
            f" got {pads.friction:g}"
        )
    friction = rf"\g<1>{pads.friction * object_friction / rest:.6f}"
    contact = {pad[2]: pad[3] for pad in _PAD.finditer(_sdf(MATERIALS[pads.material]))}

    def change(pad: re.Match[str]) -> str:
        return pad[1] + _FRICTION.sub(friction, contact[pad[2]]) + pad[4]

    path.write_text(_PAD.sub(change, _sdf(MODELS[pads.shape])), encoding="utf-8")


def _sdf(name: str) -> str:
    """Return the text of one of the package's models."""
    return (models_path() / "sdf" / f"{name}.sdf").read_text(encoding="utf-8")
