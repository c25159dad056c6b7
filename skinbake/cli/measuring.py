"""One bake, or one exact integral, measured: its light, its time, and the memory of the process that runs nothing else.

Every setting is judged at the same points of the skin, whatever its texture: the probes with which a bake at the
sweep's texture size verifies itself, read from the stored lobes bilinearly as a GPU reads them. The reference is the
exact surface integral there.
"""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.cli.exact_values import Probed, drawn_points, exact_values, stored_values
from skinbake.errors import MachineError, ToleranceMissedError
from skinbake.io.atomic import temporary_folder
from skinbake.scene.spec import SceneSpec

PICTURE = (480, 600)


def measure_bake(spec: SceneSpec, at: Probed | None, picture: bool) -> dict[str, Any]:
    """Bake once in a temporary folder and measure it.

    Parameters
    ----------
    spec : SceneSpec
    at : Probed, optional
        Where the light is wanted.
    picture : bool
        Whether a picture is wanted.

    Returns
    -------
    dict
        seconds, expected (seconds, by the cost model), cpu_seconds, stages, peak_mib, bytes; values (P, 3) and picture
        (h, w, 3) where they were wanted.
    """
    _warm(spec)
    with temporary_folder() as folder:
        cpu = time.process_time()
        manifest = _bake(spec, Path(folder))
        cpu = time.process_time() - cpu
        peak = own_peak_mib()
        found: dict[str, Any] = {
            "seconds": manifest["timings"]["total"],
            "expected": sum(manifest["timings_expected"].values()),
            "cpu_seconds": cpu,
            "stages": {stage: seconds for stage, seconds in manifest["timings"].items() if stage != "total"},
            "peak_mib": peak,
            "bytes": sum(path.stat().st_size for path in Path(folder).glob("*.exr")),
        }
        if at is not None:
            found["values"] = stored_values(Path(folder), at)
        if picture:
            found["picture"] = _picture(Path(folder))
        return found


def measure_near_exact(spec: SceneSpec, probes: int, picture: bool = True) -> dict[str, Any]:
    """Light and picture of one bake that is so fine that others may be judged by it.

    Parameters
    ----------
    spec : SceneSpec
        With a tight tolerance.
    probes : int
        How many points to draw.
    picture : bool
        Whether a picture is wanted.

    Returns
    -------
    dict
        values (P, 3), the fields of Probed, and picture where it was wanted.
    """
    at = drawn_points(spec, probes)
    found = measure_bake(spec, at, picture)
    return vars(at) | {name: found[name] for name in ("values", "picture") if name in found}


def measure_reference(spec: SceneSpec, probes: int, picture: bool, at: Probed | None = None) -> dict[str, Any]:
    """Exact integral at probes, and a picture from a bake nearly as exact.

    Parameters
    ----------
    spec : SceneSpec
    probes : int
        How many to draw.
    picture : bool
        Whether a picture is wanted.
    at : Probed, optional
        Probes in place of drawn ones.

    Returns
    -------
    dict
        values (P, 3), the fields of Probed, and picture where it was wanted.
    """
    values, at = exact_values(spec, probes, at)
    found: dict[str, Any] = {"values": values} | vars(at)
    if picture or spec.terms.transmission != "off":
        fine = spec.model_copy(
            update={
                "diffusion": spec.diffusion.model_copy(update={"method": "surface", "tolerance": 1e-4}),
                "output": spec.output.model_copy(update={"precision": "float", "compression": "none"}),
            }
        )
        with temporary_folder() as folder:
            _bake(fine, Path(folder))
            if spec.terms.transmission != "off":
                found["values"] += stored_values(Path(folder), at, through_only=True)
            if picture:
                found["picture"] = _picture(Path(folder))
    return found


def _bake(spec: SceneSpec, folder: Path) -> dict[str, Any]:
    """Bake into a folder and give the manifest, also where the tolerance was missed."""
    from skinbake.baking.bake_look import bake_look
    from skinbake.io.manifest import read_manifest

    spec = spec.model_copy(update={"output": spec.output.model_copy(update={"dir": str(folder)})})
    try:
        return bake_look(spec, force=True, preview=False, verbosity=0)
    except ToleranceMissedError:  # that is what is being measured
        return read_manifest(folder)


def _warm(spec: SceneSpec) -> None:
    """Bake a few texels first: compiled code is loaded once, and is not what differs between settings."""
    photons = {"skin": spec.skin.model_copy(update={"photons": 100})} if spec.skin.model == "transport" else {}
    tiny = spec.model_copy(
        update={"texture": spec.texture.model_copy(update={"size": (48, 48)}), **photons},
    )
    with temporary_folder() as folder:
        _bake(tiny, Path(folder))


def _picture(folder: Path) -> NDArray[np.float32] | None:
    """Linear radiance before the look's background, (h, w, 3); None where there is no OpenGL."""
    from skinbake.io.bake_folder import read_bake_folder
    from skinbake.preview.draw import OffscreenRenderer
    from skinbake.preview.mode import Mode
    from skinbake.preview.views import plan_views

    baked = read_bake_folder(folder, summed=True)
    look = baked.spec.preview
    each = plan_views(baked.scene.mesh, look, [], None, PICTURE[0] / PICTURE[1])[0]
    try:
        with OffscreenRenderer(baked.scene) as renderer:
            frame = renderer.draw(each.camera, PICTURE, Mode("full"), supersample=2)
    except MachineError:
        return None
    return (frame.over(tuple(np.asarray(look.background_rgb) / 2.0**look.exposure)) * 2.0**look.exposure).astype(
        np.float32
    )


def own_peak_mib() -> float:
    """Largest resident size of this process, MiB; on Linux without what its parent had when it was started."""
    from skinbake.machine import peak_memory_mib

    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return peak_memory_mib()
