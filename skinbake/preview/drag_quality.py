"""How coarse frames are while the mouse is moved, so that they follow it."""

from __future__ import annotations

from dataclasses import dataclass, replace

FOLLOWING_S = 1 / 14  # a frame that takes longer does not follow the hand
EASY_S = 1 / 45
COARSEST = 4
SETTLE_S = 0.2  # without a move, until the fine frame is drawn


@dataclass(frozen=True)
class DragQuality:
    """Pixels of the screen a side of one that is drawn, while the mouse is moved.

    Attributes
    ----------
    scale : int
    """

    scale: int = 1

    def after(self, seconds: float) -> DragQuality:
        """What to draw next, after a frame of this scale has taken so many seconds."""
        if seconds > FOLLOWING_S and self.scale < COARSEST:
            return replace(self, scale=self.scale + 1)
        if seconds < EASY_S and self.scale > 1:
            return replace(self, scale=self.scale - 1)
        return self
