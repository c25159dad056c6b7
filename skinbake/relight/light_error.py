"""How wrong light through a basis is, by kinds of light, as the files and the terminal tell it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from skinbake.atlas import FIRST_TILE

WORDS = {"skies": "skies", "soft_boxes": "soft boxes of 10 degrees", "suns": "suns"}


@dataclass(frozen=True)
class KindError:
    """Error over the lights of one kind, against the bake of each.

    Attributes
    ----------
    lights : int
        How many.
    rms : float
        Root of the mean over lights of the squared relative error of each, over the skin's area and channels.
    p95 : float
        95th percentile of a texel's error, relative to its light's mean.
    worst : float
        Relative rms error of the worst light.
    worst_light : dict
        That light: its name, and a sun's direction.
    worst_at : dict
        Where that light is most wrong: tile, (u, v), position in mm, and by what share of the light's mean.
    clamped : float
        Share of the light that was negative and set to 0.
    """

    lights: int
    rms: float
    p95: float
    worst: float
    worst_light: Mapping[str, Any]
    worst_at: Mapping[str, Any]
    clamped: float

    def record(self) -> dict[str, Any]:
        """As relight.json holds it."""
        return asdict(self)

    def sentence(self, kind: str) -> str:
        """A line for the terminal.

        Parameters
        ----------
        kind : str
            One of `WORDS`.
        """
        (u, v), tile = self.worst_at["uv"], self.worst_at.get("tile", FIRST_TILE)
        of_tile = "" if tile == FIRST_TILE else f" of tile {tile}"
        return (
            f"{self.lights} {WORDS[kind]}: rms {self.rms:.2%}, p95 {self.p95:.2%}, worst {self.worst:.2%} "
            f"({self.worst_light['name']}, most at u {u:.3f} v {v:.3f}{of_tile}), {self.clamped:.2%} below 0"
        )
