"""Shared fixtures: where real heads lie, plots that take no time, and the switch that renews golden images."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.plots import PLOT, draw_fit_plot, stamp_fit_plot
from tests.progress import Progress

ROOT = Path(__file__).parent.parent
ASSETS = ROOT.parent / "shared" / "assets"


def pytest_addoption(parser):
    parser.addoption("--golden-update", action="store_true", help="write the golden EXRs anew instead of comparing")


def pytest_configure(config):
    if config.get_verbosity() <= 0 and not hasattr(config, "workerinput"):  # else each test has its line already
        config.pluginmanager.register(Progress())


@pytest.fixture(scope="session", autouse=True)
def quick_plots():
    """What bakes in this process leaves a stamp as the fit's plot (see `drawn_plots`), which nobody's cache keeps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PLOT, stamp_fit_plot)
        patch.setattr("skinbake.baking.kept_fit.user_cache", lambda: None)
        yield


@pytest.fixture
def drawn_plots(monkeypatch):
    """The fit's plot is drawn, as it is for users."""
    monkeypatch.setattr(PLOT, draw_fit_plot)


@pytest.fixture
def lee_perry_smith() -> Path:
    """Folder of the scan; the README says how to get it."""
    for folder in (ASSETS / "lee_perry_smith", ROOT / "data" / "lee_perry_smith"):
        if (folder / "head.obj").is_file():
            return folder
    pytest.skip("the Lee Perry-Smith scan is not beside the project (README, 'a real scan')")
