"""Files of a comparison with transport: walks as they end, and truth.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.io.atomic import atomic_write, write_text

NAME, WALKS = "truth.json", "truth.walks.npz"


def write_walks(folder: Path, key: str, done: NDArray[np.bool_], mean: Any, stderr: Any) -> None:
    """Keep what points have so far, for a command that takes up where this one stopped.

    Parameters
    ----------
    folder : Path
    key : str
        Digest of what the walks depend on.
    done : ndarray of shape (P,), bool
    mean, stderr : ndarrays of shape (3, P, L, 3)
        As in `LightLeaving`; only those of points that are done count.
    """
    with atomic_write(folder / WALKS) as temporary:
        np.savez(temporary, key=np.array(key), done=done, mean=mean, stderr=stderr)


def read_walks(folder: Path, key: str) -> dict[str, NDArray[Any]] | None:
    """What `write_walks` kept under this key; None where there is nothing that can be read."""
    try:
        with np.load(folder / WALKS, allow_pickle=False) as file:
            found = {name: file[name] for name in ("key", "done", "mean", "stderr")}
    except Exception:  # a damaged archive is seen as one of many errors
        return None
    return found if str(found["key"]) == key else None


def write_truth(folder: Path, truth: dict[str, Any]) -> None:
    """Write truth.json: a line for each sample, the rest indented."""
    samples = truth["samples"]
    head = json.dumps(truth | {"samples": []}, indent=1)
    lines = ",\n  ".join(json.dumps(sample) for sample in samples)
    text = head.replace('"samples": []', f'"samples": [\n  {lines}\n ]', 1)
    write_text(folder / NAME, text + "\n")
