"""Shared fixtures: where real heads lie, and the switch that renews golden images."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.progress import Progress

ROOT = Path(__file__).parent.parent
ASSETS = ROOT.parent / "shared" / "assets"


def pytest_addoption(parser):
    parser.addoption("--golden-update", action="store_true", help="write the golden EXRs anew instead of comparing")


def pytest_configure(config):
    if config.get_verbosity() <= 0 and not hasattr(config, "workerinput"):  # else each test has its line already
        config.pluginmanager.register(Progress())


@pytest.fixture
def lee_perry_smith() -> Path:
    """Folder of the scan; the README says how to get it."""
    for folder in (ASSETS / "lee_perry_smith", ROOT / "data" / "lee_perry_smith"):
        if (folder / "head.obj").is_file():
            return folder
    pytest.skip("the Lee Perry-Smith scan is not beside the project (README, 'a real scan')")
