"""Links and pictures of every document lead somewhere, and every page can be reached from the README."""

from __future__ import annotations

import re

import pytest

from tests.conftest import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "skinbake" / "docs").rglob("*.md"))]
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")


def links(page):
    """Files that a page links to; addresses elsewhere left out."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.S | re.M)
    return [(page.parent / target).resolve() for target in LINK.findall(text) if "://" not in target]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    """From the folder of the page."""
    assert [target for target in links(page) if not target.exists()] == []


def test_every_page_is_reached_from_the_readme():
    """By one link or two."""
    seen, left = set(), [PAGES[0]]
    while left:
        page = left.pop()
        seen.add(page)
        left += [target for target in links(page) if target.suffix == ".md" and target not in seen]
    assert set(PAGES) <= seen


def test_the_readme_is_a_first_screen_and_a_tour():
    """What is longer stands in the documents."""
    assert len(PAGES[0].read_text().splitlines()) < 200
