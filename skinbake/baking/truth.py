"""A bake against light transport in the same skin: walks, the bake's own M at the same points, the distance."""

from __future__ import annotations

import json
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skinbake
from skinbake.atlas import tile_of_face
from skinbake.atlas.texel_coordinates import local_uv, texel_xy
from skinbake.baking.bake_look import bake_look
from skinbake.baking.session import BakeSession
from skinbake.baking.truth_maps import WALKED, VaryingSkin
from skinbake.bilinear import read_bilinear
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.errors import InputError, ToleranceMissedError
from skinbake.io.atomic import temporary_folder
from skinbake.io.bake_folder import read_bake_folder
from skinbake.io.cache import Cache
from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.io.fingerprint import input_hashes
from skinbake.io.lock import folder_lock
from skinbake.io.manifest import NAME as MANIFEST
from skinbake.io.manifest import read_manifest, transport_digest, write_manifest
from skinbake.io.scene_files import read_scene
from skinbake.io.truth import read_walks, write_truth, write_walks
from skinbake.irradiance.decide import decide
from skinbake.irradiance.oil_albedo import oil_table, transmitted_share
from skinbake.irradiance.smooth_surface import smooth_surface
from skinbake.numerics import Float
from skinbake.profile.spectrum import WAVELENGTH_NM
from skinbake.progress import Progress
from skinbake.scene.map_files import MapsSpec
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.skin import PhysiologySkin
from skinbake.scene.spec import SceneSpec, TexturingSpec
from skinbake.transport.closed import refuse_open
from skinbake.transport.light_leaving import ESTIMATES, light_leaving, medium_for_walks
from skinbake.transport.medium import SkinLayers
from skinbake.transport.medium_of_skin import medium_of_skin
from skinbake.transport.model_error import GroupError, TermShare, model_error, term_share
from skinbake.transport.points import TruthPoints, draw_points
from skinbake.transport.surface_rays import SurfaceRays

BATCH = 12  # points between two looks at the clock
KEPT_EVERY_S = 20.0
SHARE_NODES = 129
SWITCHES = ("energy_conservation",)  # terms that both sides share, so that switching them says nothing


def bare_look(spec: SceneSpec) -> SceneSpec:
    """The look that walks can be compared with, the same one where it is so already.

    Without maps but those of the skin's width, melanin and blood, of the medium's own colour, each light by itself;
    baked beside the look where that differs.

    Raises
    ------
    InputError
        Not all of the light scatters.
    """
    if spec.maps.scatter is not None or spec.skin.scatter < 1:
        what = "maps.scatter" if spec.maps.scatter is not None else "skin.scatter"
        raise InputError(
            f"truth: expected skin in which all light scatters, got {what}: what leaves where it arrives is no light "
            "that can be followed through a medium; leave it out"
        )
    skin = {"normalise": "none"} | ({"albedo": None} if isinstance(spec.skin, PhysiologySkin) else {})
    bare = spec.model_copy(
        update={
            "maps": MapsSpec(albedo_rgb=(1.0, 1.0, 1.0), **{name: getattr(spec.maps, name) for name in WALKED}),
            "skin": spec.skin.model_copy(update=skin),
            "texturing": TexturingSpec(),
            "output": spec.output.model_copy(update={"lights": "separate", "tx": False}),
        }
    )
    if bare.model_dump() == spec.model_dump():
        return spec
    folder = str(Path(spec.output.dir) / "truth")
    return bare.model_copy(update={"output": bare.output.model_copy(update={"dir": folder})})


def measure_truth(spec: SceneSpec, points: int, walks: int, terms: bool, verbosity: int = 0) -> dict[str, Any]:
    """Walk, bake what is stale, compare, and write truth.json and the manifest's `error.model`.

    Parameters
    ----------
    spec : SceneSpec
    points, walks : int
    terms : bool
        Also bake without each of the terms that the bake has.
    verbosity : int
        0 shows nothing on stderr, 1 how far it is, 2 also what its bakes say.

    Returns
    -------
    dict
        What truth.json holds: `error`, the distance by group of points; `without`, that of bakes without one of the
        terms; `split`, what each term takes off.

    Raises
    ------
    InputError
        The mesh is open, something but skin casts shadows, or the skin has no medium that light could be followed
        through.
    """
    look, progress = bare_look(spec), Progress(verbosity > 0)
    varies = [name for name in WALKED if getattr(look.maps, name) is not None]
    skin = look.skin.model_copy(update={"radius": 1.0}) if "radius" in varies else look.skin
    layers = medium_of_skin(skin, varies)
    with progress.task("reading the mesh"):
        scene = read_scene(look, rays=False)
        refuse_open(scene.mesh, look.mesh.path)
        _refuse_casters(look, scene.mesh)
        rays = SurfaceRays(smooth_surface(scene.mesh))
        grid, changes = None, None
        quantities: tuple[str, ...] = ()
        if varies:
            constants = {name: getattr(look.skin, name) for name in varies}
            varying = VaryingSkin.of(scene.mesh, scene.maps, rays.rays.centre_mm, constants)
            (grid, quantities), changes = varying.grid(), varying.changes
        medium = medium_for_walks(rays, layers, grid, quantities)
        at = draw_points(scene.mesh, rays, look.lights, points, look.output.seed, changes)
    share = None
    if decide(look).energy_conservation.enabled:
        oil = look.specular
        share = transmitted_share(np.linspace(0, 1, SHARE_NODES), oil.roughness, oil.f0, oil.strength, oil_table(oil))

    folder = Path(look.output.dir)
    with folder_lock(folder, progress.line):
        pass  # whoever cannot write there is told before the walks, not after them
    walked_through = look.skin.model_dump(exclude={"fit"})  # walks know nothing of the Gaussians
    key = key_of(
        code_digest("skinbake.transport.light_leaving", "skinbake.transport.points", "skinbake.baking.truth_maps"),
        input_hashes(look), look.mesh.model_dump(), look.maps.model_dump(include=set(WALKED)),
        [light.model_dump() for light in look.lights], look.shadows, walked_through, points, walks,
        look.output.seed, None if share is None else share.tolist(),
    )  # fmt: skip
    count = len(at.face)
    shape = (len(ESTIMATES), count, len(look.lights), 3)
    done, mean, stderr = np.zeros(count, np.bool_), np.zeros(shape), np.zeros(shape)
    kept = read_walks(folder, key)
    if kept is not None and kept["mean"].shape == shape:
        done, mean, stderr = kept["done"], kept["mean"], kept["stderr"]
        progress.line(f"{int(done.sum())} points are there already")
    saved, lock = time.monotonic(), threading.Lock()
    todo = np.flatnonzero(~done)
    with progress.task("walking light through the skin", total=len(todo)) as task:

        def one_done(number: int) -> None:
            with lock:
                task.done += number

        for start in range(0, len(todo), BATCH):
            part = todo[start : start + BATCH]
            # A point's walks depend on its number alone: points of a batch follow each other only where none was done
            for first, last in _runs(part):
                found = light_leaving(
                    rays, medium, look.lights, at.face[first:last], at.barycentric[first:last], walks,
                    look.output.seed, look.shadows, share, scene.environments, first, one_done,
                )  # fmt: skip
                mean[:, first:last], stderr[:, first:last], done[first:last] = found.mean, found.stderr, True
            task.note = f"{int(done.sum())} of {count} points"
            if time.monotonic() - saved > KEPT_EVERY_S:
                write_walks(folder, key, done, mean, stderr)
                saved = time.monotonic()
    if len(todo):
        write_walks(folder, key, done, mean, stderr)

    with progress.task("baking the same skin"):
        _bake(look, max(verbosity - 1, 0))
    baked = light_baked(folder, scene.mesh, at)
    whole, noise = mean[ESTIMATES["whole"]], stderr[ESTIMATES["whole"]]
    error = model_error(*_totals(baked, whole, noise), at.weight, at.groups)
    without: dict[str, dict[str, GroupError]] = {}
    split: dict[str, dict[str, TermShare]] = {}
    for term, values in (_without_terms(look, folder, scene.mesh, at, progress) if terms else {}).items():
        totals = _totals(values, whole, noise)
        without[term] = model_error(*totals, at.weight, at.groups)
        split[term] = term_share(baked.sum(axis=1), *totals, at.weight, at.groups)
    truth = {
        "version": skinbake.__version__,
        "medium": _described(layers),
        "walks": walks,
        "seed": look.output.seed,
        "lights": [light.name for light in look.lights],
        "error": error,
        "without": without,
        "split": split,
        "samples": _samples(look, scene.mesh, at, mean, stderr, baked),
    }
    write_truth(folder, truth)
    model = _summary(_totals(baked, whole, noise), at, error)
    model["taken_off_rgb"] = {term: share["all"]["rms_rgb"] for term, share in split.items()}
    model["of"] = transport_digest(read_manifest(folder))
    for bake in {folder, Path(spec.output.dir)}:
        if (bake / MANIFEST).is_file() and transport_digest(read_manifest(bake)) == model["of"]:
            _put_model(bake, model)
    return truth


def _refuse_casters(look: SceneSpec, mesh: SkinMesh) -> None:
    """Stop where something other than skin shadows it: the bake would be darker than walks that do not meet it.

    Raises
    ------
    InputError
        The mesh has casters; the message says how many triangles, and under which keys.
    """
    if mesh.casters is None:
        return
    raise InputError(
        f"{look.mesh.path}: truth: expected skin alone, got {len(mesh.casters.faces)} triangles that only cast "
        "shadows, which walks do not meet; put such parts under mesh.ignore and leave occluders out "
        "(--set occluders=[]), in a folder of its own (--out)"
    )


def _described(skin: SkinLayers) -> dict[str, Any]:
    """Media as truth.json has them: one as it is, several as a list from the top down."""
    layers = []
    for medium, thickness, pigment in zip(skin.layers, skin.thickness_mm, skin.pigments, strict=True):
        layer = {
            "sigma_a_per_mm": medium.sigma_a_per_mm.tolist(),
            "sigma_s_per_mm": medium.sigma_s_per_mm.tolist(),
            "g": medium.g,
            "eta": medium.eta,
        }
        if pigment is not None:
            layer |= {"map": pigment.name, "sigma_a_per_mm_of_map": pigment.sigma_a_per_mm.tolist()}
        layers.append(layer if len(skin.layers) == 1 else layer | {"thickness_mm": thickness})
    layers[-1].pop("thickness_mm", None)  # JSON has no infinity
    found: dict[str, Any] = layers[0] if len(layers) == 1 else {"layers": layers}
    return found if skin.to_rgb is None else found | {"wavelength_nm": WAVELENGTH_NM.tolist()}


def _runs(numbers: NDArray[np.int64]) -> list[tuple[int, int]]:
    """First and one past the last of each stretch of consecutive numbers."""
    breaks = np.flatnonzero(np.diff(numbers) != 1) + 1
    return [(int(part[0]), int(part[-1]) + 1) for part in np.split(numbers, breaks) if len(part)]


def _bake(look: SceneSpec, verbosity: int, session: BakeSession | None = None) -> None:
    """Bake what is stale; a missed tolerance is for the comparison to tell."""
    with suppress(ToleranceMissedError):
        bake_look(look, preview=False, verbosity=verbosity, session=session)


def _without_terms(
    look: SceneSpec, folder: Path, mesh: SkinMesh, at: TruthPoints, progress: Progress
) -> dict[str, Float]:
    """M at the points, (P, L, 3), of bakes without each of the terms that the bake has; light is traced once.

    Parameters
    ----------
    look : SceneSpec
    folder : Path
        Of the bake with all terms.
    mesh : SkinMesh
    at : TruthPoints
    progress : Progress
    """
    found, terms = {}, _terms_of(folder)
    with temporary_folder() as temporary, progress.task("baking without", total=len(terms)) as task:
        session = BakeSession(Cache(Path(temporary, "cache")))
        for task.done, term in enumerate(terms):
            task.note = term
            out = str(Path(temporary, term))
            fewer = look.terms.model_copy(update={term: "off"})
            other = look.model_copy(update={"terms": fewer, "output": look.output.model_copy(update={"dir": out})})
            _bake(other, 0, session)
            found[term] = light_baked(Path(out), mesh, at)
    return found


def _terms_of(folder: Path) -> list[str]:
    """Terms that the bake has, but those that are the walks' as well."""
    terms = read_manifest(folder)["terms"]
    return [name for name, kept in terms.items() if kept and name not in SWITCHES]


def light_baked(folder: Path, mesh: SkinMesh, at: TruthPoints) -> Float:
    """M of a bake at points, read from its files as a GPU reads them, (P, L, 3).

    Parameters
    ----------
    folder : Path
        A bake folder.
    mesh : SkinMesh
    at : TruthPoints
    """
    scene = read_bake_folder(folder).scene
    lights = len(scene.lights)
    weight = np.concatenate([1 - at.barycentric.sum(axis=1, keepdims=True), at.barycentric], axis=1)
    uv = np.einsum("pk,pki->pi", weight, mesh.corner_uv[at.face])
    tile = tile_of_face(mesh, True)[at.face]
    place = np.empty((len(uv), 2))
    for number in np.unique(tile).tolist():
        local = local_uv(uv[tile == number], number)
        place[tile == number] = np.stack(texel_xy(local[:, 0], local[:, 1], 1, 1)[::-1], axis=1)
    total = np.zeros((len(uv), lights, 3))
    several = len(next(iter(scene.lobes)).rgb) > 1
    # Of skin that varies each Gaussian counts by what the maps say at the point
    weights = SkinWeights(np.array([lobe.weight_rgb for lobe in scene.lobes]), scene.table, scene.maps)
    for lobe, weight in zip(scene.lobes, weights.at(tile, place), strict=True):
        each = np.broadcast_to(weight, (len(uv), 3))[:, None]
        for number, image in lobe.rgb.items():
            mine = np.flatnonzero(tile == number) if several else np.arange(len(uv))
            values = read_bilinear(np.asarray(image, np.float32), place[mine]).reshape(-1, lights, 3)
            total[mine] += values * each[mine]
    return total


def _totals(baked: Float, whole: Float, noise: Float) -> tuple[Float, Float, Float]:
    """Sums over the lights, (P, 3); all lights are seen by the same walks, so standard errors add up as they are."""
    return baked.sum(axis=1), whole.sum(axis=1), noise.sum(axis=1)


def _summary(totals: tuple[Float, Float, Float], at: TruthPoints, error: dict[str, GroupError]) -> dict[str, Any]:
    """What the manifest says of it."""

    def rms(found: GroupError | None, mine: NDArray[np.bool_]) -> tuple[float, float] | None:
        if found is None:
            return None
        norm = np.sqrt((at.weight[mine, None] * totals[1][mine] ** 2).sum(axis=0))
        scale = norm / max(float(np.linalg.norm(norm)), 1e-300)
        value = float(np.linalg.norm(np.array(found["rms_rgb"]) * scale))
        spread = float(np.linalg.norm(np.array(found["stderr_rgb"]) * scale))
        return value, spread

    everywhere = rms(error["all"], np.ones(len(at.weight), np.bool_))
    lit, edges = (rms(error.get(name), at.groups[name]) for name in ("lit", "edges"))
    assert everywhere is not None
    return {
        "rms": everywhere[0],
        "rms_lit": lit and lit[0],
        "rms_edges": edges and edges[0],
        "stderr": everywhere[1],
        "bias_rgb": error["all"]["bias_rgb"],
        "rms_rgb": {name: found["rms_rgb"] for name, found in error.items()},
        "points": error["all"]["points"],
    }


def _put_model(folder: Path, model: dict[str, Any]) -> None:
    """Write `error.model` into a folder's manifest; a bake without probes has no other error."""
    manifest = read_manifest(folder)
    raw = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    raw["error"] = (manifest.get("error") or {}) | {"model": model}
    write_manifest(folder, raw)


def _samples(
    look: SceneSpec, mesh: SkinMesh, at: TruthPoints, mean: Float, stderr: Float, baked: Float
) -> list[dict[str, Any]]:
    """A record for each point and light."""
    weight = np.concatenate([1 - at.barycentric.sum(axis=1, keepdims=True), at.barycentric], axis=1)
    position = np.einsum("pk,pki->pi", weight, mesh.corner_position_mm[at.face])

    def plain(values: Float) -> list[float]:
        return [float(f"{value:.6g}") for value in values]

    return [
        {
            "face": int(at.face[p]),
            "barycentric": at.barycentric[p].tolist(),
            "position_mm": plain(position[p]),
            "light": light.name,
            "M": plain(mean[ESTIMATES["whole"], p, i]),
            "stderr": plain(stderr[ESTIMATES["whole"], p, i]),
            "M_bake": plain(baked[p, i]),
            "M_hard": plain(mean[ESTIMATES["hard"], p, i]),
            "M_through": plain(mean[ESTIMATES["through"], p, i]),
            "weight": float(f"{at.weight[p]:.6g}"),
            "groups": [name for name, mine in at.groups.items() if mine[p]],
        }
        for p in range(len(at.face))
        for i, light in enumerate(look.lights)
    ]
