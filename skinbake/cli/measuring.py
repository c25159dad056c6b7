"""One bake, or one exact integral, in a process of its own: that is what makes its peak memory its own.

Every setting is judged at the same points of the skin, whatever its texture: drawn by area over the triangles, read
from the stored lobes bilinearly as a GPU reads them. The reference is the exact surface integral at these points.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError, MachineError, SkinbakeError, ToleranceMissedError
from skinbake.numerics import Float, normalized
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec

PICTURE = (480, 600)


@dataclass(frozen=True)
class SkinPoints:
    """Points drawn by area over the triangles.

    Attributes
    ----------
    face : ndarray of shape (P,)
    barycentric : ndarray of shape (P, 3)
    """

    face: NDArray[np.int64]
    barycentric: Float

    def at(self, corner_values: Float) -> Float:
        """Anything known at the corners, (P, k)."""
        return np.einsum("pc,pck->pk", self.barycentric, corner_values[self.face])


def draw_points(mesh: SkinMesh, count: int, seed: int) -> SkinPoints:
    """`count` points of the skin; the same for the same mesh and seed."""
    rng = np.random.default_rng([seed, 2])
    area = np.cumsum(mesh.face_area_mm2)
    face = np.minimum(np.searchsorted(area, rng.random(count) * area[-1], side="right"), len(area) - 1)
    a, b = rng.random((2, count))
    over = a + b > 1
    a, b = np.where(over, 1 - a, a), np.where(over, 1 - b, b)
    return SkinPoints(face, np.stack([1 - a - b, a, b], axis=1))


def in_child(task: Callable[..., Any], *arguments: Any) -> Any:
    """Run `task` in a fresh process and give what it returns.

    Raises
    ------
    SkinbakeError
        What the task raised.
    MachineError
        The process died.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(theirs, task, arguments))
    process.start()
    theirs.close()
    try:
        result = ours.recv()
    except EOFError:
        process.join()
        raise MachineError(f"a measured process died with exit code {process.exitcode} (out of memory?)") from None
    finally:
        if process.is_alive():
            process.join(0.5)
        if process.is_alive():
            process.terminate()
        process.join()
        ours.close()
    if isinstance(result, BaseException):
        raise result
    return result


def _answer(connection: Connection, task: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends us
    try:
        connection.send(task(*arguments))
    except SkinbakeError as error:
        connection.send(MachineError(str(error)) if isinstance(error, MachineError) else InputError(str(error)))
    except MemoryError:
        connection.send(MachineError("out of memory"))
    except Exception as error:
        connection.send(MachineError(f"{type(error).__name__}: {error}"))
    finally:
        connection.close()


def measure_bake(spec: SceneSpec, points: int, picture: bool) -> dict[str, Any]:
    """Bake once in a temporary folder: seconds by stage, peak memory, bytes, the light at the points, a picture."""
    from skinbake.cli.stages import peak_memory_mib

    _warm(spec)
    with TemporaryDirectory(prefix="skinbake-") as folder:
        manifest = _bake(spec, Path(folder))
        peak = peak_memory_mib()
        found: dict[str, Any] = {
            "seconds": manifest["timings"]["total"],
            "stages": {stage: seconds for stage, seconds in manifest["timings"].items() if stage != "total"},
            "peak_mib": peak,
            "bytes": sum(path.stat().st_size for path in Path(folder).glob("*.exr")),
        }
        if points:
            found["values"] = _stored_values(Path(folder), points, spec.output.seed)
        if picture:
            found["picture"] = _picture(Path(folder))
        return found


def measure_reference(spec: SceneSpec, points: int, picture: bool) -> dict[str, Any]:
    """The exact integral at the points, and a picture from a bake as near to it as the surface method comes."""
    found: dict[str, Any] = {"values": exact_values(spec, points)}
    if picture or spec.terms.transmission != "off":
        fine = spec.model_copy(
            update={
                "diffusion": spec.diffusion.model_copy(update={"method": "surface", "tolerance": 1e-4}),
                "output": spec.output.model_copy(update={"precision": "float", "compression": "none"}),
            }
        )
        with TemporaryDirectory(prefix="skinbake-") as folder:
            _bake(fine, Path(folder))
            if spec.terms.transmission != "off":
                found["values"] += _stored_values(Path(folder), points, spec.output.seed, through_only=True)
            if picture:
                found["picture"] = _picture(Path(folder))
    return found


def exact_values(spec: SceneSpec, points: int) -> Float:
    """Diffuse light at the points by the surface integral of the look's Gaussians, (P, 3), summed over lights."""
    from skinbake import pipeline
    from skinbake.diffuse.diffuser import Diffuser
    from skinbake.io.scene_files import read_scene
    from skinbake.io.table import read_profile_csv
    from skinbake.profile import fit_skin

    scene = read_scene(spec)
    path = getattr(spec.skin, "path", None)
    gaussians = fit_skin(spec.skin, read_profile_csv(path) if path else None).gaussians
    atlas = pipeline.atlas_of(spec, scene.mesh)
    irradiance = pipeline.light_skin(spec, scene, atlas)
    exponent = np.float32(spec.texturing.exponent_before)
    source = [
        (tile.rgb.sum(axis=0, keepdims=True) * pipeline.albedo_of(scene.maps, raster, scene.mesh) ** exponent)
        for tile, raster in zip(irradiance, atlas, strict=True)
    ]
    del irradiance
    diffuser = Diffuser(source, atlas, scene.mesh, spec.diffusion)
    drawn = draw_points(scene.mesh, points, spec.output.seed)
    probes = _probes(drawn, scene.mesh, diffuser, [raster.tile for raster in atlas])
    total = np.zeros((points, 3))
    for variance, weight in zip(gaussians.variance_mm2, gaussians.weight_rgb, strict=True):
        lobe = diffuser.reference(float(variance), probes) if variance > 0 else diffuser.read(source, probes, False)
        total += weight * lobe
    return total * _albedo_after(spec, scene.maps.albedo, scene.maps.albedo_rgb, drawn.at(scene.mesh.corner_uv))


def _probes(drawn: SkinPoints, mesh: SkinMesh, diffuser: Any, tiles: list[int]) -> Any:
    """The points as the diffusion's own probes; those are texels, ours lie anywhere."""
    from skinbake.atlas import signed_uv_area
    from skinbake.diffuse.probes import Probes
    from skinbake.numerics import safe_div

    height, width = diffuser.size
    place, tile = _places(drawn.at(mesh.corner_uv), tiles)
    texel_mm2 = safe_div(mesh.face_area_mm2, np.abs(signed_uv_area(mesh)) * width * height)[drawn.face]
    return Probes(
        tile=tile,
        flat_index=np.zeros(len(tile), np.int64),
        place=place,
        position=(drawn.at(mesh.corner_position_mm) - diffuser.surface.centre_mm).astype(np.float32),
        normal=normalized(drawn.at(mesh.corner_normal)).astype(np.float32),
        texel_mm2=np.minimum(texel_mm2, np.median(texel_mm2) * 16).astype(np.float32),
    )


def _places(uv: Float, tiles: list[int]) -> tuple[Float, NDArray[np.int32]]:
    """(row, column) / size within the tile, and the tile's index."""
    from skinbake.atlas import FIRST_TILE

    if tiles == [FIRST_TILE]:
        column, row, number = uv[:, 0], 1 - uv[:, 1], np.full(len(uv), FIRST_TILE)
    else:
        whole = np.floor(uv).astype(np.int64)
        column, row = uv[:, 0] - whole[:, 0], 1 - (uv[:, 1] - whole[:, 1])
        number = FIRST_TILE + whole[:, 0] + 10 * whole[:, 1]
    index = {tile: i for i, tile in enumerate(tiles)}
    return np.stack([row, column], axis=1), np.array([index.get(int(n), 0) for n in number], np.int32)


def _stored_values(folder: Path, points: int, seed: int, through_only: bool = False) -> Float:
    """Diffuse light at the points as a reader of the files sees it, (P, 3), summed over lights."""
    from skinbake.diffuse.probes import read_bilinear
    from skinbake.io.bake_folder import read_bake_folder

    baked = read_bake_folder(folder)
    scene = baked.scene
    drawn = draw_points(scene.mesh, points, seed)
    uv = drawn.at(scene.mesh.corner_uv)
    tiles = list(scene.tiles)
    place, tile = _places(uv, tiles)
    total = np.zeros((points, 3))
    for lobe in scene.lobes:
        if through_only and lobe.variance_mm2 is not None:
            continue
        for index, number in enumerate(tiles):
            mine = tile == index
            image = np.asarray(lobe.rgb[number], np.float32)
            values = read_bilinear(image, place[mine]).reshape(np.count_nonzero(mine), len(image), 3)
            total[mine] += np.asarray(lobe.weight_rgb) * values.sum(axis=1)
    return total * _albedo_after(baked.spec, scene.maps.albedo, scene.maps.albedo_rgb, uv)


def _albedo_after(spec: SceneSpec, albedo: Any, constant: tuple[float, float, float], uv: Float) -> Float:
    """albedo^(1 - x) at the points, 1 where all of it went in before the blur."""
    from skinbake.diffuse.probes import read_bilinear

    exponent = 1 - spec.texturing.exponent_before
    if exponent == 0:
        return np.ones((1, 3))
    values = np.broadcast_to(np.asarray(constant, np.float64), (len(uv), 3)).copy()
    place, tile = _places(uv, list(albedo))
    for index, image in enumerate(albedo.values()):
        values[tile == index] = read_bilinear(np.asarray(image, np.float32)[None], place[tile == index])
    return np.maximum(values, 0) ** exponent


def _bake(spec: SceneSpec, folder: Path) -> dict[str, Any]:
    from skinbake.cli.baking import bake_look
    from skinbake.io.manifest import read_manifest

    spec = spec.model_copy(update={"output": spec.output.model_copy(update={"dir": str(folder)})})
    try:
        return bake_look(spec, force=True, preview=False, verbosity=0)
    except ToleranceMissedError:  # that is what is being measured
        return read_manifest(folder)


def _warm(spec: SceneSpec) -> None:
    """A bake of a few texels first: compiled code is loaded once, and is not what differs between settings."""
    photons = {"skin": spec.skin.model_copy(update={"photons": 100})} if spec.skin.model == "transport" else {}
    tiny = spec.model_copy(
        update={"texture": spec.texture.model_copy(update={"size": (48, 48)}), **photons},
    )
    with TemporaryDirectory(prefix="skinbake-") as folder:
        _bake(tiny, Path(folder))


def _picture(folder: Path) -> NDArray[np.float32] | None:
    """Linear radiance before the look's background, (h, w, 3); None where there is no OpenGL."""
    from skinbake.io.bake_folder import read_bake_folder
    from skinbake.preview.draw import Studio
    from skinbake.preview.mode import Mode
    from skinbake.preview.shots import plan_shots

    baked = read_bake_folder(folder)
    look = baked.spec.preview
    shot = plan_shots(baked.scene.mesh, [look.view], None, PICTURE[0] / PICTURE[1])[0]
    try:
        with Studio(baked.scene) as studio:
            frame = studio.draw(shot.camera, PICTURE, Mode("full"), supersample=2)
    except MachineError:
        return None
    return (frame.over(tuple(np.asarray(look.background_rgb) / 2.0**look.exposure)) * 2.0**look.exposure).astype(
        np.float32
    )


def processors() -> int:
    """Cores that a measured bake may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
