"""Results that every look of a user may share, in the user's folder for caches."""

from __future__ import annotations

import os
from pathlib import Path

from skinbake.io.cache import Cache, cache_folder


def user_cache() -> Cache | None:
    """Cache in SKINBAKE_CACHE, else beside the kernels of `skinbake.kernels.compile`; None where there is no home."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = cache_folder(None, Path(home, "skinbake", "results") if os.path.isabs(home) else None)
    return Cache(folder) if folder else None
