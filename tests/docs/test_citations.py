"""What is cited is there: papers, equations, files."""

import re

import pytest

from tests.conftest import ROOT

SELF = "test_citations.py"  # spells out the forms that it forbids
THEORY = ROOT / "skinbake" / "docs" / "theory.md"
BIBLIOGRAPHY = ROOT / "skinbake" / "REFERENCES.bib"
IGNORED = tuple(line.strip("/") for line in (ROOT / ".gitignore").read_text().split())
TEXTS = sorted(
    file
    for folder in ("skinbake", "tests", "configs", "data", ".github", ".")
    for file in (ROOT / folder).glob("*" if folder == "." else "**/*")
    if file.suffix in (".py", ".md", ".frag", ".vert", ".yaml") and "corpus" not in file.parts and file.name != SELF
)
DOCS = [file for file in TEXTS if file.suffix == ".md"]
KEY = r"(?:[A-Za-z]+(?:19|20|17|18)\d\d[a-z]?|CIE\d+|IEC\d+)"
CITATION = re.compile(rf"\[({KEY}(?:, {KEY})*)\]")
SECTION = re.compile(r"theory\.md ((?:\d+\.\d+(?:, | and | or | to )?)+)")
EQUATION_LIKE = re.compile(r"THEORY\b|theory\.md \(|theory\.md (?:section|equation)")
CODE_PATH = re.compile(r"`([\w.-]+(?:/[\w.-]+)*/?)`")
# A file of the project is named by its path from the root; elsewhere such names stand for a user's own files
OURS = ("skinbake/", "tests/", "configs/", "data/", "docs/", ".github/", ".ci/")


def named(file):
    """A file as a test's name."""
    return file.relative_to(ROOT).as_posix()


def test_every_citation_has_its_reference_and_every_reference_its_citation():
    """Every [Key2007] in code and documents is in REFERENCES.bib, and no entry there is uncited."""
    known = set(re.findall(r"^@\w+\{([^,]+),", BIBLIOGRAPHY.read_text(), re.MULTILINE))
    cited = {
        key: named(file) for file in TEXTS for group in CITATION.findall(file.read_text()) for key in group.split(", ")
    }
    assert {key: where for key, where in cited.items() if key not in known} == {}
    assert known - set(cited) == set()


def test_every_section_of_the_theory_has_one_heading():
    """A number stands for one equation only, and numbers ascend, so that a reader finds them."""
    numbers = re.findall(r"^### (\d+)\.(\d+) ", THEORY.read_text(), re.MULTILINE)
    order = [(int(chapter), int(section)) for chapter, section in numbers]
    assert order == sorted(set(order))
    assert len(order) > 50


@pytest.mark.parametrize("file", TEXTS, ids=named)
def test_references_to_the_theory_resolve(file):
    """Each `theory.md 5.6` is a heading of theory.md, and there is no other way of citing it."""
    text = file.read_text()
    headings = set(re.findall(r"^### (\d+\.\d+) ", THEORY.read_text(), re.MULTILINE))
    # A citation may be broken over two lines of a comment
    flowing = re.sub(r"\n\s*(?:#|//)?\s*", " ", text)
    cited = {number for group in SECTION.findall(flowing) for number in re.findall(r"\d+\.\d+", group)}
    if file == THEORY:
        prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
        cited |= set(re.findall(r"\((\d+\.\d+)\)", prose))
    assert cited <= headings
    assert not EQUATION_LIKE.findall(flowing)


@pytest.mark.parametrize("file", DOCS, ids=named)
def test_every_path_in_a_document_exists(file):
    """A path in backticks leads somewhere: from the root, or from the document's own folder."""
    missing = [
        path
        for path in CODE_PATH.findall(file.read_text())
        if path.startswith(OURS) and not path.startswith(IGNORED)
        if not (ROOT / path).exists() and not (file.parent / path).exists()
    ]
    assert missing == []
