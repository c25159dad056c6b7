"""Results of a bake as the files of its folder."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skinbake
from skinbake.baking.folder_files import FolderFiles, refuse_inputs_as_outputs
from skinbake.baking.inputs import BakeInputs
from skinbake.baking.kept_fit import KeptFit, keep_fit
from skinbake.baking.provenance import Provenance
from skinbake.baking.stage_log import StageLog
from skinbake.diffuse import DiffuseMap
from skinbake.errors import InputError
from skinbake.io.atomic import write_bytes, write_text
from skinbake.io.background import Background
from skinbake.io.cache import Cache
from skinbake.io.digests import sha256_of
from skinbake.io.exr import files_of, part_file, require_codec
from skinbake.io.fingerprint import every_input
from skinbake.io.irradiance import LIGHT, TOTAL, part_keys, read_irradiance, tile_path, write_irradiance
from skinbake.io.lobes import StoredLobe, lobe_name, read_summary, read_totals, write_lobes
from skinbake.io.lock import folder_lock
from skinbake.io.manifest import write_manifest
from skinbake.io.mesh import write_obj
from skinbake.io.output_names import FIT_FILES, MESH, PICTURE, PICTURE_KEY
from skinbake.io.packed_lobes import PackedLobes
from skinbake.io.png import has_one_colour, write_png
from skinbake.io.profile import read_gaussians, write_fit
from skinbake.io.relight import TEXTURES, USE, VISIBILITY, read_use, transfer_of, write_transfer
from skinbake.io.spool import Spool
from skinbake.io.tx import is_current, tx_paths, write_tx
from skinbake.irradiance import IrradianceMap
from skinbake.profile import FitReport, GaussianSum
from skinbake.relight.transfer import Transfer


class FolderStore:
    """A `ResultStore` of files, each whole or not there at all; they are written while the next stage runs.

    Parameters
    ----------
    inputs : BakeInputs
        The look decides folder, precision, compression and tiles.
    log : StageLog
    cache : Cache, optional
        Results that looks share.
    force : bool
        Find nothing: every stage runs.

    Attributes
    ----------
    folder : Path
    before : dict
        The manifest that was there when the folder was opened; nothing where there was none, or a damaged one.
    spool : Spool
        Keeps pixels in the folder until they are written.
    written : set of str
        Names of the files that hold this bake's results, written now or found as they are.
    """

    def __init__(self, inputs: BakeInputs, log: StageLog, cache: Cache | None = None, force: bool = False) -> None:
        spec = inputs.spec
        self.folder, self.force = Path(spec.output.dir), force
        self.cache = None if force else cache
        self._inputs, self._log, self._output, self._udim = inputs, log, spec.output, spec.texture.udim
        self.spool = Spool(self.folder)
        self._background = Background()
        self._packed = PackedLobes(self.folder, spec.output.precision, spec.packing, self.spool)
        self._files = FolderFiles(self.folder)
        self.before: dict[str, Any] = self._files.read()
        self.written: set[str] = set()

    @contextmanager
    def open(self, picture: bool = False, given: Sequence[Path] = ()) -> Iterator[None]:
        """Hold the folder for this process while stages run and until their files are written.

        Parameters
        ----------
        picture : bool
            Whether a picture will be written, too.
        given : sequence of Path
            Irradiance that is read and takes the place of the folder's own, which is then not written.

        Raises
        ------
        InputError
            The folder cannot be written to, or a file of the look has the name of one that will be written, or
            somebody else's file has; or this OpenEXR cannot pack as the look asks.
        """
        spec = self._inputs.spec
        require_codec(spec.output.compression)
        own = {path.name for path in self.irradiance_paths().values()}
        read = [path for path in given if path.name not in own]
        refuse_inputs_as_outputs(spec, self.folder, [*every_input(spec), *read])
        with folder_lock(self.folder, self._log.say), closing(self._packed), self._background:
            self.before = self._files.read()
            sometimes = {PICTURE: picture, MESH: spec.texture.unwrap == "xatlas"}
            unless = [name for name, written in sometimes.items() if not written]
            self._files.refuse_foreign([*unless, *own] if given else unless)
            yield

    def finish_writing(self) -> None:
        """Wait for the files; only this waiting counts as time of writing."""
        if self._background.busy:
            with self._log.measured("write"):
                self._background.finish()

    def finish(self, manifest: dict[str, Any]) -> None:
        """Write bake.json, which lists every file of ours."""
        sizes = {name: (self.folder / name).stat().st_size for name in sorted(self._files.names | self.written)
                 if (self.folder / name).exists()}  # fmt: skip
        write_manifest(self.folder, manifest | {"bytes": sizes})
        self._files.finish()

    def remove_others(self) -> None:
        """Remove files of ours that are not of this bake: those of a light that is gone, a picture of other lobes."""
        others = self._files.names - self.written
        if self._picture_note()[1:] != self._picture_digest():  # somebody has drawn another one since
            others.discard(PICTURE)
        self._files.remove(others)

    def remove_own_picture(self) -> None:
        """Remove the picture that a bake has drawn, unless somebody has drawn another one since."""
        if self._picture_note()[1:] == self._picture_digest():
            self._files.remove({PICTURE, PICTURE_KEY})

    # The profile

    def fit(self, key: str) -> GaussianSum | None:
        """What profile.json holds, where it fits and the other two files are there."""
        if self.force or not all((self.folder / name).exists() for name in FIT_FILES):
            return None
        found = read_gaussians(self.folder / FIT_FILES[0], key)
        if found is not None:
            self.written |= set(FIT_FILES)
        return found

    def keep_fit(self, made: FitReport | KeptFit, key: str) -> None:
        """Write profile.json, .csv and .png; a fit that was made now is kept for other folders, too."""
        self._begin(FIT_FILES)
        for name in FIT_FILES:  # those of another fit: never one of each
            (self.folder / name).unlink(missing_ok=True)

        def write() -> None:
            if isinstance(made, KeptFit):
                for name, content in made.files.items():
                    write_bytes(self.folder / name, content)
            else:
                write_fit(made, self.folder, {"key": key})
                keep_fit(key, self.folder)

        self._background.do(write)

    # Light arriving

    def irradiance_paths(self) -> dict[int, Path]:
        """irradiance.exr of each tile."""
        return {tile: tile_path(self.folder / "irradiance.exr", tile, self._udim) for tile in self._inputs.tiles}

    def _part_keys(self) -> list[dict[str, str]]:
        """Key of each part of each tile's file; nothing for a file that is missing or was cut short."""
        found = [{} if self.force else part_keys(path) for path in self.irradiance_paths().values()]
        paths = self.irradiance_paths().values()
        return [keys if keys and self._as_left(path) else {} for keys, path in zip(found, paths, strict=True)]

    def _as_left(self, path: Path) -> bool:
        """Whether a texture's files are there with the sizes that they were left with."""
        return all(file.exists() and self._files.as_left(file) for file in files_of(path))

    def _found(self, paths: Iterable[Path]) -> None:
        """Note that textures are this bake's, with the files of their lights."""
        self.written |= {file.name for path in paths for file in files_of(path)}

    def _written(self, paths: Iterable[Path], lights: Iterable[str]) -> set[str]:
        """Names of the files that these textures will have, with a file a light where `output.layout` says so."""
        names, paths = [LIGHT + light for light in lights], list(paths)
        apart = names if self._output.layout == "single" else []
        return {path.name for path in paths} | {part_file(path, part).name for path in paths for part in apart}

    def light_keys(self) -> dict[str, str]:
        """Key of each light that is in every tile's file."""
        first, *others = self._part_keys()
        lights = {part: key for part, key in first.items() if part.startswith(LIGHT)}
        common = {part: key for part, key in lights.items() if all(other.get(part) == key for other in others)}
        return {part.removeprefix(LIGHT): key for part, key in common.items()}

    def has_irradiance(self, key: str) -> bool:
        """Whether every tile's file is that of `key`."""
        current = all(keys.get(TOTAL) == key for keys in self._part_keys())
        if current and self._inputs.spec.texture.unwrap == "xatlas":
            current = (self.folder / MESH).exists()
        return current

    def irradiance(self) -> tuple[IrradianceMap, ...] | None:
        """What the files hold; None where one is damaged."""
        size, paths = self._inputs.spec.texture.size, self.irradiance_paths()
        try:
            found = tuple(read_irradiance(path, tile, size) for tile, path in paths.items())
        except InputError:
            return None
        self.written |= self._mesh_names()
        self._found(paths.values())
        return found

    def _mesh_names(self) -> set[str]:
        return {MESH} if self._inputs.spec.texture.unwrap == "xatlas" else set()

    def keep_irradiance(self, maps: tuple[IrradianceMap, ...], provenance: Provenance) -> None:
        """Write irradiance.exr, and mesh.obj where the UVs are our own: whoever shades with the textures needs them.

        Files of other lights, or of another layout, go.
        """
        lights = maps[0].lights
        self._begin_texture(self._mesh_names() | self._written(self.irradiance_paths().values(), lights), "irradiance")
        paths, unit = self.irradiance_paths(), self._inputs.spec.mesh.millimetres_per_unit or 1.0
        header = self._header(provenance) | {"skinbake:key": provenance.key}
        mesh = self._inputs.scene().mesh if self._inputs.spec.texture.unwrap == "xatlas" else None

        def write() -> None:
            if mesh is not None:
                write_obj(self.folder / MESH, mesh, unit)
            for tile in maps:
                precision, compression = self._output.precision, self._inputs.spec.packing
                write_irradiance(
                    paths[tile.tile], tile, provenance.light_keys, header, precision, compression, self._output.layout
                )
                self.spool.rest()

        self._background.do(write)

    # Light leaving

    def lobe_paths(self, result: DiffuseMap) -> dict[Path, int]:
        """Every lobe's file, and its tile."""
        return {
            tile_path(self.folder / lobe_name(index, lobe), tile, self._udim): tile
            for index, lobe in enumerate(result.lobes)
            for tile in lobe.rgb
        }

    def lobes(self, key: str) -> DiffuseMap | None:
        """What the headers say, where every file is there as it was left."""
        if self.force:
            return None
        found = read_summary(self.folder, key, self._inputs.tiles, self._udim)
        if found is None or not all(self._as_left(path) for path in self.lobe_paths(found)):
            return None
        self._found(self.lobe_paths(found))
        return found

    def lobe_totals(self, result: DiffuseMap) -> DiffuseMap:
        """Lobes with the sums over their lights, from the files unless they are in memory."""
        if all(len(rgb) for lobe in result.lobes for rgb in lobe.rgb.values()):
            return result
        return read_totals(self.folder, result, self._udim)

    def pack_lobe(self, lobe: StoredLobe, lights: tuple[str, ...]) -> None:
        """Pack a lobe that is made, before `keep_lobes` is given them all."""
        if self._output.layout == "multipart":
            named = lights if self._inputs.decisions.separate_lights else ()
            for tile, rgb in lobe.rgb.items():
                self._background.do(partial(self._packed.pack, rgb, lobe.total[tile], named))

    def keep_lobes(self, result: DiffuseMap, provenance: Provenance) -> None:
        """Write lobe_*.exr and transmission.exr, and remove those of a look with more lobes."""
        separate = self._inputs.decisions.separate_lights
        names = self._written(self.lobe_paths(result), result.lights if separate else ())
        self._begin_texture(names, "lobe_", "transmission")
        header, output, udim = self._header(provenance), self._output, self._udim
        how = output.precision, self._inputs.spec.packing, separate, udim, output.layout
        self._background.do(
            lambda: write_lobes(self.folder, result, provenance.key, header, *how, self.spool, self._packed)
        )

    # Light that comes later

    def transfer(self, key: str) -> Transfer | None:
        """What relight.json says, where it fits and every file is there as it was left."""
        if self.force:
            return None
        try:
            use = read_use(self.folder)
            paths = [self.folder / name for name in (*use["files"].values(), *use["visibility"].values(), USE)]
            there = use["key"] == key and all(path.is_file() and self._files.as_left(path) for path in paths)
            headers = [part_keys(path) for path in paths[:-1]] if there else []
            if not there or not all(set(header.values()) == {key} for header in headers):
                return None
            found = transfer_of(self.folder, tiles=False)
        except InputError:
            return None
        self.written |= {path.name for path in paths}
        return found

    def keep_transfer(self, transfer: Transfer, provenance: Provenance) -> None:
        """Write relight.exr and relight.json."""
        files = (TEXTURES, VISIBILITY)
        names = {tile_path(self.folder / f, tile, self._udim).name for f in files for tile in transfer.textures} | {USE}
        self._begin(names)
        (self.folder / USE).unlink(missing_ok=True)  # that of other textures
        header, output = self._header(provenance), self._output
        self._background.do(
            lambda: write_transfer(
                self.folder, transfer, provenance.key, header, output.precision, output.compression, self._udim
            )
        )

    # Textures for renderers

    def stale_textures(self, result: DiffuseMap) -> dict[Path, int]:
        """EXR files without .tx, or with those of another bake, or with one that was cut short."""
        exrs = {path: tile for tile, path in self.irradiance_paths().items()} | self.lobe_paths(result)
        stale = {}
        for path, tile in exrs.items():
            if self.force or not is_current(path) or not all(map(self._files.as_left, tx_paths(path))):
                stale[path] = tile
            else:
                self.written |= {tx.name for tx in tx_paths(path)}
        return stale

    def keep_textures(self, path: Path, coverage: NDArray[np.floating]) -> None:
        """Write the .tx of an EXR file."""
        self._begin(tx.name for tx in tx_paths(path))
        write_tx(path, coverage)

    # The picture

    @property
    def holds_picture(self) -> bool:
        """Whether the folder has a picture of this bake."""
        return PICTURE in self.written

    @property
    def picture_is_empty(self) -> bool:
        """Whether the picture of this bake shows the background alone."""
        return self.holds_picture and has_one_colour(self.folder / PICTURE)

    def has_picture(self, key: str) -> bool:
        """Whether preview.png is the one that was drawn under `key`, and nobody has drawn another since."""
        current = not self.force and self._picture_note() == [key, *self._picture_digest()]
        if current:
            self.written |= {PICTURE, PICTURE_KEY}
        return current

    def _picture_note(self) -> list[str]:
        try:
            return (self.folder / PICTURE_KEY).read_text(encoding="utf-8").split()
        except (OSError, ValueError):
            return []

    def _picture_digest(self) -> list[str]:
        try:
            return [sha256_of(self.folder / PICTURE)]
        except InputError:
            return []

    def keep_picture(self, pixels: NDArray[np.uint8], key: str) -> None:
        """Write preview.png, and beside it what it was drawn of."""
        self._begin((PICTURE, PICTURE_KEY))
        (self.folder / PICTURE_KEY).unlink(missing_ok=True)
        write_png(self.folder / PICTURE, pixels)
        write_text(self.folder / PICTURE_KEY, f"{key} {sha256_of(self.folder / PICTURE)}\n")

    def _begin(self, names: Any) -> None:
        names = set(names)
        self.written |= names
        self._files.begin(names)

    def _begin_texture(self, names: set[str], *begins: str) -> None:
        """Begin to write textures, and remove those of the same kind, by how names begin, that will not be theirs."""
        left = {name for name in self._files.names if name.startswith(begins)} - names
        self._begin(names)
        self._files.remove(left)
        self.written -= left

    def _header(self, provenance: Provenance) -> dict[str, Any]:
        """Attributes that every EXR carries."""
        return {
            "skinbake:version": skinbake.__version__,
            "skinbake:inputs": json.dumps(dict(provenance.inputs), sort_keys=True),
        }
