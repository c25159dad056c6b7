"""The pipeline with files between its stages: each stage is run only when what it reads has changed."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import skinbake
from skinbake import pipeline
from skinbake.atlas import Atlas
from skinbake.atlas.report import refuse_spoilt, uv_report
from skinbake.bake.cache_entries import atlas_entry, atlas_of_entry, light_entries, merged_lights
from skinbake.bake.folder import FIT_FILES, BakeFolder
from skinbake.bake.keys import blur_key, profile_key, raster_key
from skinbake.diffuse import DiffuseMap
from skinbake.errors import InputError
from skinbake.io.irradiance import read_irradiance, write_irradiance
from skinbake.io.lobes import as_stored_lobes, write_lobes
from skinbake.io.manifest import NAME
from skinbake.io.mesh import write_obj
from skinbake.io.profile import write_fit
from skinbake.irradiance import IrradianceMap
from skinbake.profile import GaussianSum, fit_skin
from skinbake.stored_precision import as_stored


class StageRunner(BakeFolder):
    """One look on its way into its folder."""

    def write(self, work: Callable[[], None]) -> None:
        """Have files written while the next stage runs. The manifest goes first and comes last: a folder that has one
        is whole.
        """
        (self.out / NAME).unlink(missing_ok=True)
        self.background.do(work)

    def finish_writing(self) -> None:
        """Wait for the files; only this waiting counts as time of writing."""
        if self.background.busy:
            with self.timed("write"):
                self.background.finish()

    @cached_property
    def atlas(self) -> Atlas:
        """Raster of the mesh, made when first needed."""
        key = raster_key(self.spec, self.inputs)

        def rasterise(names: tuple[str, ...]) -> dict[str, Any]:
            mesh = self.scene.mesh
            with self.timed("raster"):
                return {"raster": atlas_entry(pipeline.atlas_of(self.spec, mesh))}

        def make() -> Atlas:
            found = self.cache.get_many({"raster": key}, rasterise) if self.cache else rasterise(("raster",))
            return atlas_of_entry(found["raster"])

        return self.session.last("atlas", key, make)

    def refuse_spoilt(self) -> None:
        """Read what is new and stop at what would spoil the bake, before anything is written.

        Raises
        ------
        InputError
            A file that cannot be used, or UVs whose faults `check` reports.
        MachineError
            More memory than there is.
        """
        if self.stale_lights() is not None:
            pipeline.refuse_too_large(self.spec, len(self.tiles))
            refuse_spoilt(uv_report(self.scene.mesh, self.atlas), self.spec.mesh.path)

    @property
    def header(self) -> dict[str, Any]:
        """Attributes that every EXR carries."""
        return {"skinbake:version": skinbake.__version__, "skinbake:inputs": json.dumps(self.inputs, sort_keys=True)}

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
                self.background.do(lambda: write_fit(report, self.out, {"key": profile_key(self.spec, self.inputs)}))
                gaussians = report.gaussians
        return gaussians

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

        mesh = self.scene.mesh

        def write() -> None:
            if self.spec.texture.unwrap == "xatlas":  # whoever shades with the textures needs the UVs they are on
                write_obj(self.out / "mesh.obj", mesh, self.spec.mesh.millimetres_per_unit or 1.0)
            for tile in result:
                path = paths[tile.tile]
                write_irradiance(path, tile, self.light_keys, self.header, precision, self.spec.output.compression)

        self.write(write)
        return result

    def _lights(self, names: tuple[str, ...], atlas: Atlas) -> Mapping[str, Any]:
        """Entries of lights by name, from the cache or made.

        Rounded as the file will hold them: a bake taken up from files or from the cache must not differ from one made
        in one go.
        """
        rounded = partial(as_stored, precision=self.spec.output.precision)

        def make(missing: tuple[str, ...]) -> dict[str, Any]:
            made = pipeline.light_skin(self.spec, self.scene, atlas, missing, rounded)
            self.session.traced += missing
            return light_entries(made)

        with self.timed("irradiance"):
            if self.cache is None:
                return make(names) if names else {}
            return self.cache.get_many({name: self.light_keys[name] for name in names}, make)

    def diffuse(self, gaussians: GaussianSum, irradiance: tuple[IrradianceMap, ...], light_id: Any) -> DiffuseMap:
        """Blur; writes lobe_*.exr. `light_id` identifies the irradiance: the key of each light by name, or anything."""
        spec = self.spec
        key = self.diffuse_key(gaussians, light_id)
        found = self.kept_lobes(key)
        if found is not None:
            with self.timed("diffuse", reused=True):
                return found
        scene, atlas, cache = self.scene, self.atlas, self.cache
        by_light = spec.output.lights == "separate"

        def remember(kind: Any, names: tuple[str, ...], make: Any) -> Any:
            assert cache is not None
            return cache.get_many({name: blur_key(spec, self.inputs, light_id[name], kind) for name in names}, make)

        with self.timed("diffuse"):
            diffused = pipeline.scatter(
                spec,
                scene,
                atlas,
                irradiance,
                gaussians,
                say=lambda text: self.say(f"    {text}", 2),
                remember=remember if cache is not None and isinstance(light_id, Mapping) and by_light else None,
            )
            result = as_stored_lobes(diffused, spec.output.precision)

        def write() -> None:
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
                by_light,
                spec.texture.udim,
            )

        self.write(write)
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
