"""What a look asks to be written, and the picture that its bake ends with."""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Field, field_validator

from skinbake.scene.strict import Also, Between, Strict

ExportKind = Literal["sum", "layers", "gltf", "blender", "web"]
EXPORT_KINDS: tuple[str, ...] = get_args(ExportKind)


def _one_as_many(value: Any) -> Any:
    """One name as a list of it."""
    return (value,) if isinstance(value, str) else value


Exports = Annotated[tuple[ExportKind, ...], BeforeValidator(_one_as_many), Also("string", enum=list(EXPORT_KINDS))]


class OutputSpec(Strict):
    """Folder, format and content of what is written."""

    dir: Annotated[str, Field(min_length=1)]
    """Folder that the bake is written to; one look, one folder."""
    precision: Literal["half", "float"] = "half"
    """Floats of 16 or of 32 bits; images too bright or too faint for `half` are floats."""
    compression: Literal["auto", "none", "rle", "zips", "zip", "piz", "htj2k"] = "auto"
    """Of the EXR files, none of which loses a digit; `auto` is the fastest that packs well and that all programs read:
    `piz` of halves, `zip` of floats, `rle` of a draft's halves (from a tolerance of 0.05 on), in half the time and a
    third more room. `htj2k` takes half of the others' time and, of large textures, two thirds of their room; OpenEXR
    before 3.4 reads such a file as if it were damaged. Exports are never packed so."""
    layout: Literal["multipart", "single"] = "multipart"
    """Lights of a texture are parts of its file, or, for programs that see the first part only, files of their own."""
    lights: Literal["separate", "total"] = "separate"
    """Store each light on its own, so that it can be changed later, or all of them summed."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Of everything that is drawn at random."""
    tx: bool = False
    """Also write tiled, mip-mapped textures for renderers."""
    export: Exports = ()
    """What `skinbake export` writes, after each bake into its folder `export`; with `web` also one page of a batch."""

    @field_validator("export")
    @classmethod
    def _once(cls, kinds: tuple[ExportKind, ...]) -> tuple[ExportKind, ...]:
        return tuple(dict.fromkeys(kinds))

    @property
    def separate_lights(self) -> bool:
        """Whether each light is diffused and stored on its own."""
        return self.lights == "separate"


View = Literal["front", "left", "right", "three-quarter", "three-quarter-right", "back", "nose", "lips", "eyes", "ear"]
PictureSize = Annotated[int, Field(ge=1, le=8192)]
STOPS = 100
FARTHEST_MM = 1e5  # of a camera: a head is less than a hundredth of its picture there
Place = Annotated[float, Between(-FARTHEST_MM, FARTHEST_MM)]
Shade = Annotated[float, Field(ge=0, le=1e6)]


class CameraSpec(Strict):
    """A camera on an orbit about a point of the head; +y is up."""

    target_mm: tuple[Place, Place, Place]
    """What it looks at, mm."""
    distance_mm: Annotated[float, Between(1, FARTHEST_MM)]
    """How far away it stands, mm."""
    azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """0 looks at the face, 90 at the head's left side."""
    elevation_deg: Annotated[float, Field(ge=-89, le=89)] = 0.0
    """How far above the target, degrees."""


class PreviewSpec(Strict):
    """Picture that a bake ends with; the verb `preview` can override it."""

    size: tuple[PictureSize, PictureSize] = (768, 960)
    """Width and height in pixels."""
    view: View = "three-quarter"
    """Where the camera stands."""
    camera: CameraSpec | None = None
    """A place of one's own, in place of `view`'s; the window's key W writes it."""
    exposure: Annotated[float, Field(ge=-STOPS, le=STOPS)] = 0.0
    """Stops."""
    background_rgb: tuple[Shade, Shade, Shade] = (0.018, 0.019, 0.022)
    """Linear colour behind the head."""
