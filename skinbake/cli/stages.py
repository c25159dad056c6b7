"""The pipeline with files between its stages: each stage is run only when what it reads has changed."""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

import skinbake
from skinbake import pipeline
from skinbake.atlas import Atlas, tiles_of
from skinbake.cli.keys import diffuse_key, light_key, profile_key
from skinbake.diffuse import DiffuseMap
from skinbake.io.exr import as_stored
from skinbake.io.fingerprint import input_hashes
from skinbake.io.irradiance import light_keys, read_irradiance, tile_path, write_irradiance
from skinbake.io.lobes import read_summary, write_lobes
from skinbake.io.profile import read_gaussians, write_fit
from skinbake.io.scene_files import read_scene
from skinbake.irradiance import IrradianceMap
from skinbake.profile import GaussianSum, fit_skin
from skinbake.scene.spec import SceneSpec


class Stages:
    """One look on its way into a folder.

    Attributes
    ----------
    reused : dict of stage name to bool
        Whether the stage's files were taken as they were.
    timings : dict of stage name to seconds
    """

    def __init__(self, spec: SceneSpec, force: bool = False, verbosity: int = 1) -> None:
        self.spec = spec
        self.out = Path(spec.output.dir)
        self.force = force
        self.console = Console(file=sys.stderr, quiet=verbosity == 0, highlight=False, soft_wrap=True)
        self.verbosity = verbosity
        self.timings: dict[str, float] = {}
        self.reused: dict[str, bool] = {}

    @contextmanager
    def timed(self, stage: str, reused: bool = False) -> Iterator[None]:
        """Take the time of a stage and say it."""
        start = time.perf_counter()
        yield
        seconds = time.perf_counter() - start
        self.timings[stage] = self.timings.get(stage, 0.0) + seconds
        self.reused[stage] = reused
        self.say(f"  {stage:<12}" + ("as it was" if reused else f"{seconds:6.2f} s"))

    def say(self, text: str, level: int = 1) -> None:
        """Tell the person at the terminal, on stderr."""
        if self.verbosity >= level:
            self.console.print(text, markup=False)

    @cached_property
    def inputs(self) -> dict[str, str]:
        """sha256 of every file the look reads, by role."""
        return input_hashes(self.spec)

    @cached_property
    def scene(self) -> pipeline.SceneData:
        """Mesh, maps and environments, read when first needed."""
        with self.timed("read"):
            return read_scene(self.spec)

    @cached_property
    def atlas(self) -> Atlas:
        """Raster of the mesh, made when first needed."""
        scene = self.scene
        with self.timed("raster"):
            return pipeline.atlas_of(self.spec, scene.mesh)

    @cached_property
    def tiles(self) -> tuple[int, ...]:
        """UDIM numbers of the look."""
        return tiles_of(self.scene.mesh, True) if self.spec.texture.udim else (1001,)

    @property
    def header(self) -> dict[str, Any]:
        """Attributes that every EXR carries."""
        return {"skinbake:version": skinbake.__version__, "skinbake:inputs": json.dumps(self.inputs, sort_keys=True)}

    def profile(self) -> GaussianSum:
        """Fit the skin; writes profile.json, .csv and .png."""
        key = profile_key(self.spec, self.inputs)
        gaussians = None if self.force else read_gaussians(self.out / "profile.json", key)
        with self.timed("profile", reused=gaussians is not None):
            if gaussians is None:
                from skinbake.io.table import read_profile_csv

                path = getattr(self.spec.skin, "path", None)
                table = read_profile_csv(path) if path else None
                report = fit_skin(self.spec.skin, table)
                write_fit(report, self.out, {"key": key})
                gaussians = report.gaussians
        return gaussians

    @cached_property
    def light_keys(self) -> dict[str, str]:
        """Key of each light's irradiance, in the order of the look."""
        kept = pipeline.energy_conservation(self.spec).kept
        return {light.name: light_key(self.spec, self.inputs, light.name, kept) for light in self.spec.lights}

    def irradiance(self) -> tuple[IrradianceMap, ...]:
        """Light arriving, each light traced only where it is new or has changed; writes irradiance.exr."""
        size, udim, precision = self.spec.texture.size, self.spec.texture.udim, self.spec.output.precision
        paths = {tile: tile_path(self.out / "irradiance.exr", tile, udim) for tile in self.tiles}
        found = [{} if self.force else light_keys(path) for path in paths.values()]
        if all(list(keys.items()) == list(self.light_keys.items()) for keys in found):
            with self.timed("irradiance", reused=True):
                return tuple(read_irradiance(path, tile, size) for tile, path in paths.items())
        stale = tuple(name for name, key in self.light_keys.items() if any(keys.get(name) != key for keys in found))
        kept = (
            [read_irradiance(path, tile) for tile, path in paths.items()] if len(stale) < len(self.light_keys) else []
        )
        scene, atlas = self.scene, self.atlas
        with self.timed("irradiance"):
            new = pipeline.light_skin(self.spec, scene, atlas, stale)
            result = tuple(
                _merged(tuple(self.light_keys), new[i], kept[i] if kept else None, precision) for i in range(len(atlas))
            )
        with self.timed("write"):
            for tile in result:
                path = paths[tile.tile]
                write_irradiance(path, tile, self.light_keys, self.header, precision, self.spec.output.compression)
        return result

    def diffuse(self, gaussians: GaussianSum, irradiance: tuple[IrradianceMap, ...], light_id: Any) -> DiffuseMap:
        """Blur; writes lobe_*.exr. `light_id` is what identifies the irradiance."""
        spec = self.spec
        weights = (gaussians.variance_mm2.tolist(), gaussians.weight_rgb.tolist())
        key = diffuse_key(spec, self.inputs, weights, light_id)
        found = None if self.force else read_summary(self.out, key, self.tiles, spec.texture.udim)
        if found is not None:
            with self.timed("diffuse", reused=True):
                return found
        scene, atlas = self.scene, self.atlas
        with self.timed("diffuse"):
            result = pipeline.scatter(
                spec, scene, atlas, irradiance, gaussians, say=lambda text: self.say(f"    {text}", 2)
            )
        with self.timed("write"):
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


def _merged(names: tuple[str, ...], new: IrradianceMap, kept: IrradianceMap | None, precision: str) -> IrradianceMap:
    """Lights in the order of `names`, from `new` where it has them.

    Rounded as the file will hold them: a bake taken up from its files must not differ from one made in one go.
    """
    source = [
        (m, m.lights.index(name)) for name in names for m in [new if kept is None or name in new.lights else kept]
    ]
    rgb, visibility = (np.stack([getattr(m, field)[i] for m, i in source]) for field in ("rgb", "visibility"))
    rgb = as_stored(rgb, precision)
    return IrradianceMap(new.tile, names, rgb, as_stored(visibility[..., None], precision)[..., 0], new.coverage)


def peak_memory_mib() -> float:
    """Largest resident size of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)
