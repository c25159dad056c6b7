"""Folder of numba's machine code.

Numba looks only at the file of the function it compiles: a kernel that has inlined one of another file would run the
old one after that file was changed. So the folder is named after the content of every file that has kernels.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path

PACKAGE = Path(__file__).parent.parent


def use_fresh_cache() -> None:
    """Set NUMBA_CACHE_DIR, unless somebody has, to a folder of this very code; called before numba is imported."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    digest = hashlib.sha256()
    for file in sorted(PACKAGE.rglob("*.py")):
        source = file.read_bytes()
        if b"numba" in source:
            digest.update(str(file.relative_to(PACKAGE)).encode() + b"\0" + source)
    folder = PACKAGE / "__pycache__"
    mine = folder / f"numba-{digest.hexdigest()[:16]}"
    try:
        mine.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # a package that cannot be written to: numba has its own folder for that
    for stale in folder.glob("numba-*"):
        if stale != mine:
            shutil.rmtree(stale, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(mine)
