"""A page in a notebook."""

from __future__ import annotations

import html


class Viewer:
    """A page that a notebook shows in a frame.

    Parameters
    ----------
    page : str
        HTML.
    height : int
        Of the frame, in pixels.
    """

    def __init__(self, page: str, height: int) -> None:
        self.page, self.height = page, height

    def _repr_html_(self) -> str:
        """The page as the source of a frame: its scripts and styles touch nothing of the notebook."""
        style = f"width:100%;height:{self.height}px;border:0"
        return f'<iframe title="The baked head" style="{style}" srcdoc="{html.escape(self.page)}"></iframe>'
