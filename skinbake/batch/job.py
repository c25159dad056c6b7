"""One job of a batch, in whatever process it runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skinbake.errors import ConfigError, InputError, MachineError, ToleranceMissedError
from skinbake.scene.spec import SceneSpec

if TYPE_CHECKING:
    from skinbake.baking.shared_blurs import BlurBase, SharedBlurs


@dataclass(frozen=True)
class BakeJob:
    """A look and how to bake it.

    Attributes
    ----------
    spec : SceneSpec
    force, preview : bool
        As the verb `bake`.
    cache : str or None
        Folder of the shared results.
    cache_bytes : int
    code : str
        Digest of the code that gave the job; another process must have the same.
    advice : str
        What to do where it has not.
    blurs : SharedBlurs, optional
        Of a look that differs from an earlier one in its skin alone.
    """

    spec: SceneSpec
    force: bool
    preview: bool
    cache: str | None
    cache_bytes: int
    code: str
    advice: str = "update it, or start the batch again"
    blurs: SharedBlurs | None = None

    @property
    def base(self) -> BlurBase | None:
        """The skin whose blurs the look takes, where it does."""
        return self.blurs.base if self.blurs else None


def bake_job(job: BakeJob, tell: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Bake one look and give its entry of batch.json. An error that the user can mend is part of the entry.

    Raises
    ------
    MachineError
        Another machine may do better: disk full, no OpenGL, other code than the one that gave the job.
    """
    from skinbake.baking.session import BakeSession
    from skinbake.export.after_bake import bake_and_export
    from skinbake.io.code_digest import package_digest
    from skinbake.io.manifest import read_manifest

    if package_digest() != job.code:
        raise MachineError(f"this worker runs another version of skinbake than what sent the job; {job.advice}")
    start = time.perf_counter()
    stages: dict[str, bool] = {}

    def on_event(event: dict[str, Any]) -> None:
        """Note which stages ran, and pass the event on."""
        if "reused" in event:
            stages[event["stage"]] = event["reused"]
        tell(event)

    session = BakeSession.of(job.cache, job.cache_bytes, on_event, base=job.base)
    status, fault = "done", None
    try:
        manifest = bake_and_export(job.spec, job.force, job.preview, verbosity=0, session=session)
    except ToleranceMissedError as error:
        status, fault = "missed", str(error)
        manifest = read_manifest(job.spec.output.dir)
    except (InputError, ConfigError) as error:
        return {"status": "failed", "error": str(error), "seconds": time.perf_counter() - start}
    if status == "done" and all(reused for stage, reused in stages.items() if stage != "read"):
        status = "fresh"  # reading, as for which tiles there are, makes nothing
    found = manifest["error"] or {}
    return {
        "status": status,
        "error": fault,
        "seconds": round(time.perf_counter() - start, 3),
        "ran": [stage for stage, reused in stages.items() if not reused],
        "reused": [stage for stage, reused in stages.items() if reused],
        "traced": list(session.traced),
        "cache": session.figures,
        "peak_memory_mib": manifest["peak_memory_mib"],
        "measured": _measured(found) if "rms" in found else {},
        "note": "; ".join(filter(None, (_error(manifest), job.blurs.why if job.blurs and job.base else ""))),
        "blurs": job.blurs and job.blurs.why,
        "preview": "preview.png" if (Path(job.spec.output.dir) / "preview.png").exists() else None,
    }


def _measured(error: dict[str, Any]) -> dict[str, Any]:
    """All that is left wrong, and the blur's part of it."""
    return {"left_wrong": error["left_wrong"], "blur": {name: error[name] for name in ("rms", "p95", "max")}}


def _error(manifest: dict[str, Any]) -> str:
    """The error of a look; of one whose lights a transfer shows, what is said of that."""
    found = manifest["error"] or {}
    if "rms" in found:
        return f"off by {found['left_wrong']:.2%} from its own model"
    return next((line["why"] for line in manifest["plan"] if line["term"] == "relight.reuse" and line["kept"]), "")
