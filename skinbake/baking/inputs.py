"""What a bake reads: the look, digests of its files, and their contents when they are first asked for."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from skinbake.atlas import FIRST_TILE, tiles_of
from skinbake.baking.inputs_roles import DETAILED, OCCLUDERS, OF_MATERIALS
from skinbake.baking.kept_fit import fit_key, kept_fit
from skinbake.baking.session import BakeSession
from skinbake.baking.shared_blurs import BlurBase
from skinbake.baking.stage_log import StageLog
from skinbake.diffuse.planning.texture_size import TextureSize, at_size, choose_size, may_be_reduced
from skinbake.errors import InputError
from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.io.fingerprint import input_hashes, input_stamps
from skinbake.io.mesh.files import mesh_files
from skinbake.io.scene_files import read_scene
from skinbake.io.spool import Spool
from skinbake.io.table import read_profile_csv
from skinbake.irradiance.decide import decide
from skinbake.irradiance.scene_data import SceneData
from skinbake.profile import FitReport, GaussianSum, fit_skin
from skinbake.profile.fit_onto import fit_onto
from skinbake.profile.skin_albedo import PIGMENTS
from skinbake.profile.varying_skin import Range, ranges_of
from skinbake.scene.maps import IMAGES, OF_SKIN
from skinbake.scene.mesh_files import OF_FILE
from skinbake.scene.skin import PhysiologySkin
from skinbake.scene.spec import SceneSpec

BYTES_A_TRIANGLE = {".obj": 88, ".png": 0, ".jpg": 0, ".jpeg": 0}  # of a mesh's files
_OTHERS_BYTES = 40


def _layout_of_its_own(spec: SceneSpec) -> bool:
    """Whether reading the scene made maps at the texture's size."""
    maps = spec.maps
    return spec.texture.unwrap != "none" or maps.vertex_colors or maps.height is not None or maps.detail is not None


class BakeInputs:
    """One look and its files.

    Attributes
    ----------
    spec : SceneSpec
        As it is worked on: where a loose tolerance allows a coarser texture, with that size.
    asked : SceneSpec
        The look as it was written.
    texture_size : TextureSize
        That size, and what it loses.
    decisions : Decisions
        What follows from the look alone.
    digests : dict of role to str
        sha256 of every file the look reads: "mesh", "albedo", "light.NAME", "skin", ...
    """

    def __init__(self, spec: SceneSpec, session: BakeSession, log: StageLog) -> None:
        self.spec = self.asked = spec
        self._session, self._log = session, log
        self._stamps = input_stamps(spec)
        self.digests = input_hashes(spec)
        self._scene: SceneData | None = None
        self._tiles: tuple[int, ...] | None = None if spec.texture.udim else (FIRST_TILE,)
        self.texture_size = self._texture_size()
        self.spec = at_size(spec, self.texture_size)
        self.decisions = replace(decide(self.spec, self.texture_size.lost), texture_size=self.texture_size.decision)

    @property
    def reduced(self) -> bool:
        """Whether it is worked at a smaller size than was asked for: beside its maps, such a bake is small."""
        return self.spec.texture.size != self.asked.texture.size

    def _texture_size(self) -> TextureSize:
        """The size to work at, which every stage's key holds; what looks of one process share is decided once."""
        if not may_be_reduced(self.spec):
            return TextureSize(self.spec.texture.size)
        spec = self.spec
        key = key_of(
            code_digest("skinbake.diffuse.planning.texture_size"),
            self.key("mesh", *DETAILED, *self.skin_maps),
            (spec.diffusion.tolerance, spec.output.seed, spec.texturing.exponent_before),
            (spec.skin.model_dump(mode="json", exclude={"path"}), self.digests.get("skin")),
            self.base and self.base.identity,
        )
        found = self._session.peek("texture_size", key)
        if found is None:
            scene = self.scene()
            chosen = choose_size(spec, scene.mesh, scene.maps, self.gaussians())
            found = self._session.put("texture_size", key, chosen)
            if found.size != spec.texture.size and _layout_of_its_own(spec):
                self._scene = None  # made at the other size
        return found

    def scene(self) -> SceneData:
        """Mesh, maps and environments.

        Raises
        ------
        InputError
            A file is missing or unusable, or was changed since it was hashed.
        """
        if self._scene is None:
            as_written = (
                self.spec.model_dump(mode="json", include={"mesh", "occluders", "maps"}),
                self.spec.specular.roughness,  # widened by details that are finer than the texture
            )
            key = key_of(self.key("albedo", *(role for role in self.digests if role != "skin")), as_written)
            self._scene = self._session.peek("scene", key) or self._session.put("scene", key, self._read())
        return self._scene

    @property
    def triangles(self) -> int:
        """How many the mesh and what shadows it have, about: by the length of files not read yet."""
        if self._scene is not None:
            mesh = self._scene.mesh
            return len(mesh.faces) + (len(mesh.casters.faces) if mesh.casters is not None else 0)
        paths = [
            *mesh_files(self.spec.mesh.path),
            *(file for of in self.spec.occluders for file in mesh_files(of.path)),
        ]
        lengths = [(path, (self._stamps.get(path) or (0, 0))[1]) for path in paths]
        each = [(BYTES_A_TRIANGLE.get(path.suffix.lower(), _OTHERS_BYTES), length) for path, length in lengths]
        return sum(length // of for of, length in each if of)

    @property
    def skin_maps(self) -> tuple[str, ...]:
        """Maps of the look that vary its skin."""
        return tuple(name for name in OF_SKIN if getattr(self.spec.maps, name) is not None)

    @cached_property
    def varying(self) -> dict[str, Range]:
        """What the maps vary of the skin, and between which values."""
        return ranges_of(self.scene().maps, self.spec.skin, self.tiles) if self.skin_maps else {}

    @cached_property
    def fit(self) -> FitReport:
        """The skin's Gaussians, fitted: asked for only where they are not stored."""
        path = self.table_path
        table = read_profile_csv(path) if path else None
        if self.base:
            return fit_onto(self.spec.skin, self.base.gaussians.variance_mm2, table)
        return fit_skin(self.spec.skin, table, over=self.varying)

    def gaussians(self) -> GaussianSum:
        """The skin's, of whoever has them."""
        if self.base:
            return self.base.gaussians
        kept = kept_fit(fit_key(self))
        return kept.gaussians if kept else self.fit.gaussians

    @property
    def base(self) -> BlurBase | None:
        """The skin whose blurs the look takes, where it does."""
        return self._session.base

    def put_aside(self, spool: Spool) -> None:
        """Have the maps that were read stand in files while nobody reads them."""
        if self._scene is not None and not self._session.keep:
            maps = self._scene.maps
            kept: dict[str, Any] = {name: spool.keep_all(getattr(maps, name)) for name in IMAGES}
            self._scene = replace(self._scene, maps=replace(maps, **kept))

    def work_on(self, scene: SceneData) -> None:
        """Take a scene for that of the files: the same one in another form."""
        self._scene = scene

    def close(self) -> None:
        """Let go of what was read: only a stage yet to run has use for it."""
        self._scene = None

    @property
    def tiles(self) -> tuple[int, ...]:
        """UDIM numbers of the mesh; 1001 alone where the look has none."""
        if self._tiles is None:
            self._tiles = tiles_of(self.scene().mesh, True)
        return self._tiles

    def key(self, *roles: str) -> str:
        """Digest of what `scene` holds of some roles: contents of files, how they are read, and the code that does.

        Where files lie makes no difference.
        """
        return key_of(code_digest("skinbake.io.scene_files"), {role: self._part(role) for role in sorted(roles)})

    def _part(self, role: str) -> Any:
        spec, digest = self.spec, self.digests.get(role)
        if role == "mesh":
            texture = spec.texture.model_dump(mode="json")
            return spec.mesh.model_dump(mode="json", exclude={"path", "any_size", "opacity"}), texture, digest
        if role == OCCLUDERS:
            placed = [each.model_dump(mode="json", exclude={"path", "opacity"}) for each in spec.occluders]
            pictures = [(name, picture == OF_FILE) for name, picture in spec.mesh.opacity.items()]
            pictures += [("", each.opacity == OF_FILE) for each in spec.occluders]
            return placed, pictures, sorted(item for item in self.digests.items() if item[0].startswith("occluder."))
        if role.startswith("light."):
            light = next(light for light in spec.lights if f"light.{light.name}" == role)
            return light.model_dump(mode="json", exclude={"path"}), digest, self.digests.get("ocio")
        chosen = getattr(spec.maps, role, None)
        # What stands in for a map: a constant, or what the mesh's own file holds, whose digest every stage has
        others: tuple[Any, ...] = (spec.maps.albedo_rgb, spec.maps.vertex_colors) if role == "albedo" else ()
        if role == "albedo" and isinstance(spec.skin, PhysiologySkin) and spec.skin.albedo is not None:
            others += (spec.skin.model_dump(mode="json"), [self._part(name) for name in PIGMENTS])
        source = spec.maps.source if chosen is None and role in OF_MATERIALS else None
        written = chosen and chosen.model_dump(mode="json", exclude={"path"})
        return written, digest, others, source, self.digests.get("ocio")

    def _read(self) -> SceneData:
        with self._log.measured("read"):
            scene = read_scene(self.spec, waiting=self._log.waiting)
        self._refuse_changed()
        for note in (*scene.mesh.notes, *scene.notes, *scene.warnings):
            self._log.say(f"  {note}")
        return scene

    def _refuse_changed(self) -> None:
        """What was read is what was hashed, or results would be kept under the key of something else."""
        for path, stamp in input_stamps(self.spec).items():
            if self._stamps.get(path) != stamp:
                raise InputError(f"{path}: it was changed while it was read; run again")

    @property
    def table_path(self) -> Path | None:
        """CSV of the profile, where the skin is a table."""
        path = getattr(self.spec.skin, "path", None)
        return Path(path) if path else None
