"""Modes of the preview: the whole picture, or one part of it."""

from __future__ import annotations

from dataclasses import dataclass

from skinbake.errors import InputError

NAMES = ("full", "diffuse", "specular", "none")


@dataclass(frozen=True)
class Mode:
    """Part of a bake that the picture shows.

    Attributes
    ----------
    name : "full", "diffuse", "specular", "none" or "lobe"
        "none" leaves the scattering out: irradiance times albedo where the light arrives, with the specular.
    lobe : int
        Which blurred texture "lobe" shows, as stored (weight 1).
    """

    name: str = "full"
    lobe: int = 0

    @property
    def diffuse(self) -> bool:
        """Whether light from inside the skin is shown."""
        return self.name != "specular"

    @property
    def specular(self) -> bool:
        """Whether the oil layer is shown."""
        return self.name in ("full", "specular", "none")

    def __str__(self) -> str:
        return f"lobe:{self.lobe}" if self.name == "lobe" else self.name


def parse_mode(text: str, lobes: int) -> Mode:
    """Mode from `full`, `diffuse`, `specular`, `none` or `lobe:i`.

    Raises
    ------
    InputError
        For anything else, and for a lobe the bake does not have.
    """
    name, _, index = text.strip().partition(":")
    if name in NAMES and not index:
        return Mode(name)
    if name == "lobe" and index.isdecimal() and int(index) < lobes:
        return Mode("lobe", int(index))
    raise InputError(f"--mode: expected full, diffuse, specular, none or lobe:0 ... lobe:{lobes - 1}, got {text}")
