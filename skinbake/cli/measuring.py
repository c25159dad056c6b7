"""One bake, or one exact integral, in a process of its own, so that the peak memory is that of the bake alone.

Every setting is judged at the same points of the skin, whatever its texture: the probes with which a bake at the
sweep's texture size verifies itself, read from the stored lobes bilinearly as a GPU reads them. The reference is the
exact surface integral there.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError, MachineError, SkinbakeError, ToleranceMissedError
from skinbake.interrupt import install, starting_children
from skinbake.io.atomic import temporary_folder
from skinbake.numerics import Float
from skinbake.scene.spec import SceneSpec

PICTURE = (480, 600)


@dataclass(frozen=True)
class Probed:
    """Points of the skin at which every setting is judged.

    Attributes
    ----------
    place : ndarray of shape (P, 2)
        (row, column) / size within the tile.
    tile : ndarray of shape (P,)
        UDIM number.
    position_mm, normal : ndarray of shape (P, 3)
    texture_mm2 : ndarray of shape (P,)
        Skin area that a whole tile would span at the scale found there: times 1 / texels, that of one texel.
    """

    place: Float
    tile: NDArray[np.int32]
    position_mm: Float
    normal: NDArray[np.float32]
    texture_mm2: NDArray[np.float32]


class Child:
    """Fresh process that runs one task after another; a context manager."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with starting_children():
            self._process.start()
        theirs.close()

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.close()  # the child sees the end and leaves; one in the middle of a bake is ended
        self._process.join(0.5)
        if self._process.is_alive():
            self._process.terminate()
        self._process.join()

    def __call__(self, task: Callable[..., Any], *arguments: Any) -> Any:
        """Run `task(*arguments)` in the process, and give its result.

        Raises
        ------
        SkinbakeError
            What the task raised.
        MachineError
            The process died.
        """
        try:
            self._ours.send((task, arguments))
            result = self._ours.recv()
        except (EOFError, BrokenPipeError):
            self._process.join()
            raise MachineError(
                f"a measured bake died with exit code {self._process.exitcode} (out of memory?)"
            ) from None
        if isinstance(result, SkinbakeError):
            raise result
        return result


def in_child(task: Callable[..., Any], *arguments: Any) -> Any:
    """Run one task in a process of its own."""
    with Child() as child:
        return child(task, *arguments)


def _serve(connection: Connection) -> None:
    """Loop of the process: take a task, send its result or its error, until the other end closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends us
    install(say=False, signals=(signal.SIGTERM,))
    while True:
        try:
            task, arguments = connection.recv()
        except EOFError:
            return
        try:
            result = task(*arguments)
        except MachineError as error:
            result = MachineError(str(error))
        except SkinbakeError as error:
            result = InputError(str(error))
        except MemoryError:
            result = MachineError("out of memory")
        except Exception as error:
            result = MachineError(f"{type(error).__name__}: {error}")
        try:
            connection.send(result)
        except OSError:  # nobody waits for it any more
            return


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
            found["values"] = _stored_values(Path(folder), at)
        if picture:
            found["picture"] = _picture(Path(folder))
        return found


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
                found["values"] += _stored_values(Path(folder), at, through_only=True)
            if picture:
                found["picture"] = _picture(Path(folder))
    return found


def exact_values(spec: SceneSpec, count: int, at: Probed | None = None) -> tuple[Float, Probed]:
    """Diffuse light by the surface integral of the look's Gaussians, (P, 3), summed over lights, and the probes.

    Parameters
    ----------
    spec : SceneSpec
    count : int
        Probes to draw as a bake of this look draws those it verifies itself with.
    at : Probed, optional
        Probes of another texture size instead.
    """
    from skinbake.atlas.look_atlas import look_atlas
    from skinbake.baking.incidence_table import incidence_table
    from skinbake.diffuse.draw_probes import draw_probes
    from skinbake.diffuse.light_entering import light_entering
    from skinbake.diffuse.methods import REFERENCE, LobeParameters
    from skinbake.diffuse.probes import Probes, read_at_probes
    from skinbake.diffuse.resources import LobeResources
    from skinbake.diffuse.skin_geometry import SkinGeometry
    from skinbake.diffuse.skin_weights import SkinWeights, VaryingSkin
    from skinbake.io.scene_files import read_scene
    from skinbake.io.table import read_profile_csv
    from skinbake.irradiance.decide import decide
    from skinbake.irradiance.light_skin import light_skin
    from skinbake.profile import fit_skin
    from skinbake.profile.skin_medium import skin_medium
    from skinbake.profile.varying_skin import mean_skin, ranges_of

    scene = read_scene(spec)
    path = getattr(spec.skin, "path", None)
    atlas = look_atlas(spec.texture, scene.mesh)
    over = ranges_of(scene.maps, spec.skin, [raster.tile for raster in atlas])
    gaussians = fit_skin(spec.skin, read_profile_csv(path) if path else None, over=over).gaussians
    decisions, medium = decide(spec), skin_medium(mean_skin(spec.skin, over))
    irradiance = light_skin(spec, decisions, scene, atlas)
    incidence = incidence_table(medium) if medium.layers and spec.terms.incidence != "off" else None
    entering = light_entering(spec, decisions, scene, atlas, irradiance, gaussians, medium, incidence)
    source, of_wide = (
        {tile: rgb.sum(axis=0, keepdims=True, dtype=np.float32) for tile, rgb in light.items()}
        for light in (entering.rgb, entering.beam.rgb if entering.beam else {})
    )
    wide_mm2 = entering.beam.narrowest_mm2 if entering.beam else np.inf
    del irradiance, entering
    geometry = SkinGeometry(atlas, scene.mesh)
    skin = VaryingSkin.of(gaussians, scene.maps, atlas)
    share = skin.share if skin else None
    resources = LobeResources(source, geometry, spec.diffusion, share)
    resources_of_wide = LobeResources(of_wide, geometry, spec.diffusion, share) if of_wide else resources
    if at is None:
        probes = draw_probes(geometry, count, spec.output.seed)
        own = probes.position + geometry.centre_mm
        at = Probed(probes.place, probes.tile, own, probes.normal, probes.texel_mm2 * np.prod(geometry.size))
    else:
        probes = Probes(
            at.tile,
            np.zeros(len(at.tile), np.int64),
            at.place,
            (at.position_mm - geometry.centre_mm).astype(np.float32),
            at.normal,
            (at.texture_mm2 / np.prod(geometry.size)).astype(np.float32),
        )
    total = np.zeros((len(probes), 3))
    weights = SkinWeights.of(gaussians, scene.maps).at_probes(probes)
    for variance, weight in zip(gaussians.variance_mm2, weights, strict=True):
        lobe = LobeParameters(float(variance))
        blurred = resources_of_wide if variance >= wide_mm2 else resources
        # Probes of another size have no texel of their own to read where there is no blur
        read = REFERENCE.at_probes(blurred, lobe, probes) if variance > 0 else read_at_probes(source, probes)
        total += weight * read
    return total * _albedo_after(spec, scene.maps.albedo, scene.maps.albedo_rgb, at), at


def _stored_values(folder: Path, at: Probed, through_only: bool = False) -> Float:
    """Diffuse light at probes as a reader of the files sees it, (P, 3), summed over lights."""
    from skinbake.bilinear import read_bilinear
    from skinbake.diffuse.skin_weights import SkinWeights
    from skinbake.io.bake_folder import read_bake_folder

    baked = read_bake_folder(folder, summed=True)
    scene = baked.scene
    total = np.zeros((len(at.tile), 3))
    weights = SkinWeights(np.array([lobe.weight_rgb for lobe in scene.lobes]), scene.table, scene.maps)
    for lobe, weight in zip(scene.lobes, weights.at(at.tile, at.place), strict=True):
        if through_only and lobe.variance_mm2 is not None:
            continue
        for tile, stored in lobe.rgb.items():
            mine = at.tile == tile
            image = np.asarray(stored, np.float32)
            values = read_bilinear(image, at.place[mine]).reshape(np.count_nonzero(mine), len(image), 3)
            total[mine] += np.broadcast_to(weight, total.shape)[mine] * values.sum(axis=1)
    return total * _albedo_after(baked.spec, scene.maps.albedo, scene.maps.albedo_rgb, at)


def _albedo_after(spec: SceneSpec, albedo: Any, constant: tuple[float, float, float], at: Probed) -> Float:
    """albedo^(1 - x) at the probes, 1 where all of it went in before the blur."""
    from skinbake.bilinear import read_bilinear

    exponent = 1 - spec.texturing.exponent_before
    if exponent == 0:
        return np.ones((1, 3))
    values = np.broadcast_to(np.asarray(constant, np.float64), (len(at.tile), 3)).copy()
    for tile, image in albedo.items():
        mine = at.tile == tile
        values[mine] = read_bilinear(np.asarray(image, np.float32)[None], at.place[mine])
    return np.maximum(values, 0) ** exponent


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
