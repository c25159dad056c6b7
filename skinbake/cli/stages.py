"""The pipeline with files between its stages: each stage is run only when what it reads has changed."""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

from rich.console import Console

import skinbake
from skinbake import pipeline
from skinbake.atlas import Atlas, tiles_of
from skinbake.cli.keys import blur_key, diffuse_key, light_key, profile_key, raster_key
from skinbake.cli.shared import atlas_entry, atlas_of_entry, light_entries, merged_lights
from skinbake.cli.workshop import Workshop
from skinbake.diffuse import DiffuseMap
from skinbake.errors import InputError
from skinbake.io.fingerprint import input_hashes, input_stamps, key_of
from skinbake.io.irradiance import light_keys, read_irradiance, tile_path, write_irradiance
from skinbake.io.lobes import lobe_name, read_summary, write_lobes
from skinbake.io.lock import folder_lock
from skinbake.io.manifest import NAME, read_manifest
from skinbake.io.mesh import write_obj
from skinbake.io.profile import read_gaussians, write_fit
from skinbake.io.scene_files import read_scene
from skinbake.irradiance import IrradianceMap
from skinbake.profile import GaussianSum, fit_skin
from skinbake.scene.spec import SceneSpec

FIT_FILES = ("profile.json", "profile.csv", "profile.png")  # in the order of their writing


class Stages:
    """One look on its way into a folder.

    Attributes
    ----------
    reused : dict of stage name to bool
        Whether the stage's files were taken as they were.
    timings : dict of stage name to seconds
    """

    def __init__(
        self, spec: SceneSpec, force: bool = False, verbosity: int = 1, workshop: Workshop | None = None
    ) -> None:
        self.spec = spec
        self.out = Path(spec.output.dir)
        self.force = force
        self.console = Console(file=sys.stderr, quiet=verbosity == 0, highlight=False, soft_wrap=True)
        self.verbosity = verbosity
        self.workshop = workshop or Workshop()
        self.timings: dict[str, float] = {}
        self._stamps: dict[Path, tuple[int, ...] | None] = {}
        self._inner = [0.0]  # seconds of the stages inside each one that runs
        self.reused: dict[str, bool] = {}

    @contextmanager
    def timed(self, stage: str, reused: bool = False) -> Iterator[None]:
        """Take the time of a stage, without that of stages inside it, and say it."""
        self.workshop.hear({"event": "stage", "stage": stage})
        start = time.perf_counter()
        self._inner.append(0.0)
        yield
        whole = time.perf_counter() - start
        seconds = whole - self._inner.pop()
        self._inner[-1] += whole
        self.timings[stage] = self.timings.get(stage, 0.0) + seconds
        self.reused[stage] = reused
        self.workshop.hear({"event": "stage end", "stage": stage, "seconds": seconds, "reused": reused})
        self.say(f"  {stage:<12}" + ("as it was" if reused else f"{seconds:6.2f} s"))

    def say(self, text: str, level: int = 1) -> None:
        """Tell the person at the terminal, on stderr."""
        if self.verbosity >= level:
            self.console.print(text, markup=False)

    def locked(self) -> AbstractContextManager[None]:
        """Hold the folder while stages run."""
        return folder_lock(self.out, self.say)

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Time of writing. The manifest goes first and comes last: a folder that has one is whole."""
        with self.timed("write"):
            (self.out / NAME).unlink(missing_ok=True)
            yield

    @cached_property
    def inputs(self) -> dict[str, str]:
        """sha256 of every file the look reads, by role."""
        self._stamps = input_stamps(self.spec)
        return input_hashes(self.spec)

    def _check_inputs(self) -> None:
        """What was read is what was hashed, or results would be kept under the key of something else."""
        for path, stamp in input_stamps(self.spec).items():
            if self._stamps.get(path) != stamp:
                raise InputError(f"{path}: it was changed while it was read; run again")

    @cached_property
    def scene(self) -> pipeline.SceneData:
        """Mesh, maps and environments, read when first needed."""
        look = self.spec.model_dump(mode="json", include={"mesh", "maps", "texture"})
        skies = [light.model_dump(mode="json") for light in self.spec.lights if light.type == "environment"]
        roles = {role: digest for role, digest in self.inputs.items() if role != "skin"}
        key = key_of(look, skies, roles)

        def read() -> pipeline.SceneData:
            with self.timed("read"):
                scene = read_scene(self.spec)
            self._check_inputs()
            return scene

        return self.workshop.last("scene", key, read)

    @cached_property
    def atlas(self) -> Atlas:
        """Raster of the mesh, made when first needed."""
        key = raster_key(self.spec, self.inputs)

        def make() -> Atlas:
            cache = self.workshop.cache
            if cache is None:
                mesh = self.scene.mesh
                with self.timed("raster"):
                    return pipeline.atlas_of(self.spec, mesh)
            return atlas_of_entry(cache.get_many({"raster": key}, lambda names: {"raster": rasterise()})["raster"])

        def rasterise() -> dict[str, Any]:
            mesh = self.scene.mesh
            with self.timed("raster"):
                return atlas_entry(pipeline.atlas_of(self.spec, mesh))

        return self.workshop.last("atlas", key, make)

    @cached_property
    def tiles(self) -> tuple[int, ...]:
        """UDIM numbers of the look."""
        return tiles_of(self.scene.mesh, True) if self.spec.texture.udim else (1001,)

    @property
    def header(self) -> dict[str, Any]:
        """Attributes that every EXR carries."""
        return {"skinbake:version": skinbake.__version__, "skinbake:inputs": json.dumps(self.inputs, sort_keys=True)}

    def kept_fit(self) -> GaussianSum | None:
        """What profile.json holds, where it fits and the other two files are there."""
        if self.force or not all((self.out / name).exists() for name in FIT_FILES):
            return None
        return read_gaussians(self.out / FIT_FILES[0], profile_key(self.spec, self.inputs))

    def profile(self) -> GaussianSum:
        """Fit the skin; writes profile.json, .csv and .png."""
        gaussians = self.kept_fit()
        with self.timed("profile", reused=gaussians is not None):
            if gaussians is None:
                from skinbake.io.table import read_profile_csv

                path = getattr(self.spec.skin, "path", None)
                table = read_profile_csv(path) if path else None
                report = fit_skin(self.spec.skin, table)
                for name in FIT_FILES:  # those of another fit: never one of each
                    (self.out / name).unlink(missing_ok=True)
                write_fit(report, self.out, {"key": profile_key(self.spec, self.inputs)})
                gaussians = report.gaussians
        return gaussians

    @cached_property
    def light_keys(self) -> dict[str, str]:
        """Key of each light's irradiance, in the order of the look."""
        kept = pipeline.energy_conservation(self.spec).kept
        return {light.name: light_key(self.spec, self.inputs, light.name, kept) for light in self.spec.lights}

    @property
    def irradiance_paths(self) -> dict[int, Path]:
        """File of each tile."""
        return {tile: tile_path(self.out / "irradiance.exr", tile, self.spec.texture.udim) for tile in self.tiles}

    @cached_property
    def recorded_bytes(self) -> dict[str, int]:
        """Size of each file by name, as the last bake left it."""
        try:
            return dict(read_manifest(self.out)["bytes"])
        except (InputError, LookupError, TypeError, ValueError):
            return {}

    def _as_left(self, path: Path) -> bool:
        """Whether a file has the size it was left with: a copy may have been cut short since."""
        size = path.stat().st_size
        return self.recorded_bytes.get(path.name, size) == size

    def stale_lights(self) -> tuple[str, ...] | None:
        """Lights that irradiance.exr has not as they are now; None where the file is just what is wanted."""
        found = []
        for path in self.irradiance_paths.values():
            keys = {} if self.force else light_keys(path)
            found.append(keys if keys and self._as_left(path) else {})
        if all(list(keys.items()) == list(self.light_keys.items()) for keys in found):
            return None
        return tuple(name for name, key in self.light_keys.items() if any(keys.get(name) != key for keys in found))

    def irradiance(self) -> tuple[IrradianceMap, ...]:
        """Light arriving, each light traced only where it is new or has changed; writes irradiance.exr."""
        size, precision = self.spec.texture.size, self.spec.output.precision
        paths = self.irradiance_paths
        stale, kept = self.stale_lights(), list[IrradianceMap]()
        try:
            if stale is None:
                with self.timed("irradiance", reused=True):
                    return tuple(read_irradiance(path, tile, size) for tile, path in paths.items())
            if len(stale) < len(self.light_keys):
                kept = [read_irradiance(path, tile, size) for tile, path in paths.items()]
        except InputError:  # damaged: as good as missing
            stale = tuple(self.light_keys)
        atlas = self.atlas
        found = self._lights(stale, atlas)
        result = merged_lights(tuple(self.light_keys), found, kept, atlas)
        with self.writing():
            if self.spec.texture.unwrap == "xatlas":  # whoever shades with the textures needs the UVs they are on
                write_obj(self.out / "mesh.obj", self.scene.mesh, self.spec.mesh.millimetres_per_unit)
            for tile in result:
                path = paths[tile.tile]
                write_irradiance(path, tile, self.light_keys, self.header, precision, self.spec.output.compression)
        return result

    def _lights(self, names: tuple[str, ...], atlas: Atlas) -> Mapping[str, Any]:
        """Entries of lights by name, from the cache or made."""

        def make(missing: tuple[str, ...]) -> dict[str, Any]:
            made = pipeline.light_skin(self.spec, self.scene, atlas, missing)
            self.workshop.traced += missing
            return light_entries(made, self.spec.output.precision)

        cache = self.workshop.cache
        with self.timed("irradiance"):
            if cache is None:
                return make(names) if names else {}
            return cache.get_many({name: self.light_keys[name] for name in names}, make)

    def diffuse_key(self, gaussians: GaussianSum, light_id: Any) -> str:
        """Of the lobes."""
        weights = (gaussians.variance_mm2.tolist(), gaussians.weight_rgb.tolist())
        return diffuse_key(self.spec, self.inputs, weights, light_id)

    def kept_lobes(self, key: str) -> DiffuseMap | None:
        """What the folder's lobes say of themselves, where they are those of `key`."""
        if self.force:
            return None
        found = read_summary(self.out, key, self.tiles, self.spec.texture.udim)
        if found is None or not all(self._as_left(path) for path in self.lobe_paths(found)):
            return None
        return found

    def diffuse(self, gaussians: GaussianSum, irradiance: tuple[IrradianceMap, ...], light_id: Any) -> DiffuseMap:
        """Blur; writes lobe_*.exr. `light_id` identifies the irradiance: the key of each light by name, or anything."""
        spec = self.spec
        key = self.diffuse_key(gaussians, light_id)
        found = self.kept_lobes(key)
        if found is not None:
            with self.timed("diffuse", reused=True):
                return found
        scene, atlas, cache = self.scene, self.atlas, self.workshop.cache

        def remember(kind: Any, names: tuple[str, ...], make: Any) -> Any:
            assert cache is not None
            return cache.get_many({name: blur_key(spec, self.inputs, light_id[name], kind) for name in names}, make)

        with self.timed("diffuse"):
            result = pipeline.scatter(
                spec,
                scene,
                atlas,
                irradiance,
                gaussians,
                say=lambda text: self.say(f"    {text}", 2),
                remember=remember if cache is not None and isinstance(light_id, Mapping) else None,
            )
        with self.writing():
            for pattern in ("lobe_*.exr", "lobe_*.tx", "transmission*"):  # of a look with more lobes
                for left in sorted(self.out.glob(pattern)):  # lobe_0 first: it vouches for the others
                    left.unlink()
            write_lobes(
                self.out,
                result,
                key,
                self.header,
                spec.output.precision,
                spec.output.compression,
                spec.output.lights == "separate",
                spec.texture.udim,
            )
        return result

    def textures(self, irradiance: tuple[IrradianceMap, ...], result: DiffuseMap) -> list[Path]:
        """.tx of every EXR, where the look wants them."""
        from skinbake.io.tx import is_current, write_tx

        coverage = {tile.tile: tile.coverage for tile in irradiance}
        exrs = {path: tile for tile, path in self.irradiance_paths.items()} | self.lobe_paths(result)
        left = all(self._as_left(path) for path in self.out.glob("*.tx"))
        stale = [path for path in exrs if self.force or not left or not is_current(path)]
        with self.timed("textures", reused=not stale):
            for path in stale:
                write_tx(path, coverage[exrs[path]])
        return sorted(self.out.glob("*.tx"))

    def lobe_paths(self, result: DiffuseMap) -> dict[Path, int]:
        """Every lobe's file, and its tile."""
        udim = self.spec.texture.udim
        return {
            tile_path(self.out / lobe_name(index, lobe), tile, udim): tile
            for index, lobe in enumerate(result.lobes)
            for tile in lobe.rgb
        }


def peak_memory_mib() -> float:
    """Largest resident size of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)
