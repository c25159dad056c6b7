"""A look's folder: what is in it, and whether that is what the look asks for."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

from rich.console import Console

from skinbake import pipeline
from skinbake.atlas import tiles_of
from skinbake.bake.keys import diffuse_key, light_key, profile_key
from skinbake.bake.session import BakeSession
from skinbake.diffuse import DiffuseMap
from skinbake.errors import InputError
from skinbake.io.background import Background
from skinbake.io.fingerprint import input_hashes, input_stamps, key_of
from skinbake.io.irradiance import light_keys, tile_path
from skinbake.io.lobes import lobe_name, read_summary
from skinbake.io.lock import folder_lock
from skinbake.io.manifest import read_manifest
from skinbake.io.profile import read_gaussians
from skinbake.io.scene_files import read_scene
from skinbake.profile import GaussianSum
from skinbake.scene.spec import SceneSpec

FIT_FILES = ("profile.json", "profile.csv", "profile.png")  # in the order of their writing


class BakeFolder:
    """One look and the folder it is baked into.

    Attributes
    ----------
    reused : dict of stage name to bool
        Whether the stage's files were taken as they were.
    timings : dict of stage name to seconds
    before : dict
        What bake.json held when the folder was locked; nothing where there was none, or a damaged one.
    """

    def __init__(
        self, spec: SceneSpec, force: bool = False, verbosity: int = 1, session: BakeSession | None = None
    ) -> None:
        self.spec = spec
        self.out = Path(spec.output.dir)
        self.force = force
        self.console = Console(file=sys.stderr, quiet=verbosity == 0, highlight=False, soft_wrap=True)
        self.verbosity = verbosity
        self.session = session or BakeSession()
        self.cache = None if force else self.session.cache
        self.background = Background()
        self.timings: dict[str, float] = {}
        self.before: dict[str, Any] = {}
        self._stamps: dict[Path, tuple[int, ...] | None] = {}
        self._inner = [0.0]  # seconds of the stages inside each one that runs
        self.reused: dict[str, bool] = {}

    @contextmanager
    def timed(self, stage: str, reused: bool = False) -> Iterator[None]:
        """Take the time of a stage, without that of stages inside it, and say it."""
        self.session.on_event({"event": "stage", "stage": stage})
        start = time.perf_counter()
        self._inner.append(0.0)
        try:
            yield
        finally:
            whole = time.perf_counter() - start
            seconds = whole - self._inner.pop()
            self._inner[-1] += whole
        self.timings[stage] = self.timings.get(stage, 0.0) + seconds
        self.reused[stage] = reused
        self.session.on_event({"event": "stage end", "stage": stage, "seconds": seconds, "reused": reused})
        self.say(f"  {stage:<12}" + ("as it was" if reused else f"{seconds:6.2f} s"))

    def say(self, text: str, level: int = 1) -> None:
        """Tell the person at the terminal, on stderr."""
        if self.verbosity >= level:
            self.console.print(text, markup=False)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the folder while stages run and until their files are written."""
        with folder_lock(self.out, self.say), self.background:
            self.before = self._manifest()
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
        look = self.spec.model_dump(mode="json", include={"mesh", "occluders", "maps", "texture"})
        skies = [light.model_dump(mode="json") for light in self.spec.lights if light.type == "environment"]
        roles = {role: digest for role, digest in self.inputs.items() if role != "skin"}
        key = key_of(look, skies, roles)

        def read() -> pipeline.SceneData:
            with self.timed("read"):
                scene = read_scene(self.spec)
            for note in scene.mesh.notes:
                self.say(f"  {note}")
            self._check_inputs()
            return scene

        return self.session.last("scene", key, read)

    def let_go(self) -> None:
        """Of mesh, maps and raster: a quarter of a gigabyte that only a stage yet to run has use for."""
        for name in ("scene", "atlas"):
            self.__dict__.pop(name, None)

    @cached_property
    def tiles(self) -> tuple[int, ...]:
        """UDIM numbers of the look."""
        return tiles_of(self.scene.mesh, True) if self.spec.texture.udim else (1001,)

    def kept_fit(self) -> GaussianSum | None:
        """What profile.json holds, where it fits and the other two files are there."""
        if self.force or not all((self.out / name).exists() for name in FIT_FILES):
            return None
        return read_gaussians(self.out / FIT_FILES[0], profile_key(self.spec, self.inputs))

    @cached_property
    def light_keys(self) -> dict[str, str]:
        """Key of each light's irradiance, in the order of the look."""
        kept = pipeline.energy_conservation(self.spec).kept
        return {light.name: light_key(self.spec, self.inputs, light.name, kept) for light in self.spec.lights}

    @property
    def irradiance_paths(self) -> dict[int, Path]:
        """File of each tile."""
        return {tile: tile_path(self.out / "irradiance.exr", tile, self.spec.texture.udim) for tile in self.tiles}

    def _manifest(self) -> dict[str, Any]:
        try:
            return read_manifest(self.out)
        except InputError:
            return {}

    @cached_property
    def recorded_bytes(self) -> dict[str, int]:
        """Size of each file by name, as the last bake left it."""
        return dict(self._manifest().get("bytes", {}))

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

    def lobe_paths(self, result: DiffuseMap) -> dict[Path, int]:
        """Every lobe's file, and its tile."""
        udim = self.spec.texture.udim
        return {
            tile_path(self.out / lobe_name(index, lobe), tile, udim): tile
            for index, lobe in enumerate(result.lobes)
            for tile in lobe.rgb
        }
