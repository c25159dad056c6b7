"""batch.html: the pages of all looks of a batch side by side, turned together."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

NAME = "batch.html"
_VIEWER = Path(__file__).parent / "viewer"
_MARK = '<meta name="generator" content="skinbake batch">'
_BEGIN_CHARACTERS = 1000  # in which the mark is


class PageLook(NamedTuple):
    """One look: its name, its page relative to that of the batch, and a line about it."""

    name: str
    page: str
    note: str


def batch_page(title: str, looks: Sequence[PageLook]) -> str:
    """The page as text: a frame a look, which share their view, what they show, and their exposure.

    Parameters
    ----------
    title : str
    looks : sequence of PageLook
    """
    frames = []
    for look in looks:
        name, source = html.escape(look.name), html.escape(look.page)
        frames.append(
            f'<figure><iframe src="{source}#panel=0" title="{name}" loading="lazy"></iframe>'
            f"<figcaption><b>{name}</b> {html.escape(look.note)}</figcaption></figure>"
        )
    page = (_VIEWER / "batch.html").read_text(encoding="utf-8")
    for mark, content in {"@MARK@": _MARK, "@TITLE@": html.escape(title), "@LOOKS@": "\n".join(frames)}.items():
        page = page.replace(mark, content)
    return page


def is_batch_page(path: Path) -> bool:
    """Whether there is such a page of ours, or nothing."""
    try:
        with open(path, encoding="utf-8") as file:
            return _MARK in file.read(_BEGIN_CHARACTERS)
    except FileNotFoundError:
        return True
    except (OSError, ValueError):
        return False
