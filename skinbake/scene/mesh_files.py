"""The mesh of a look and what shadows it: files, units, parts."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from skinbake.scene.strict import Also, Positive, Strict

MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "inch": 25.4}


Patterns = Annotated[
    tuple[str, ...], BeforeValidator(lambda value: [value] if isinstance(value, str) else value), Also("string")
]


class MeshFileSpec(Strict):
    """A mesh file and how it lies in the scene, whose y is up and whose face looks along z."""

    path: str
    """File: OBJ, PLY, glTF or GLB, STL, OFF, or USD with the extra `usd`."""
    unit: Literal["mm", "cm", "dm", "m", "inch", "file"] | None = None
    """Unit of the file's lengths; `file` takes what the file says (glTF: metres). Either this or `mm_per_unit`."""
    mm_per_unit: Positive | None = None
    """Millimetres of one unit of the file."""
    up: Literal["y", "z"] | None = None
    """Axis of the file that points up; by default what the file says of itself, else y."""
    front: Literal["z", "-z", "x", "-x"] = "z"
    """Axis along which the face looks, once up is up."""
    flip_v: bool = False
    """Whether v runs down in the file, as in textures of three.js."""
    uv_set: Annotated[int, Field(ge=0, le=63)] | None = None
    """Number of the glTF's UV set; by default that of its material."""
    time: Annotated[Annotated[float, Field(ge=-1e6, le=1e6)] | None, Also("string")] = None
    """Time of a USD stage; by default its earliest. `"####"` is the frame's number, with `frames`."""

    @model_validator(mode="after")
    def _one_unit(self) -> MeshFileSpec:
        if (self.unit is None) == (self.mm_per_unit is None):
            raise ValueError("expected exactly one of unit (mm, cm, dm, m, inch, file) and mm_per_unit")
        return self

    @property
    def millimetres_per_unit(self) -> float | None:
        """Length of one mesh unit; None: the file says it."""
        return MM_PER_UNIT.get(str(self.unit), self.mm_per_unit)


OF_FILE = "file"  # in place of a path: what the mesh's own file holds


def _picture_of_all(value: Any) -> Any:
    """One picture as that of all parts."""
    return {"*": value} if isinstance(value, str) else value


class MeshSpec(MeshFileSpec):
    """The head, and what its file's parts are: names or patterns with * and ?.

    `skin` is baked; without it everything is that neither casts nor is ignored. `cast` shadows the skin, as does all
    that `skin` leaves out; `ignore` is as if it were not there. `opacity` is a picture for all that casts, or one for
    each name of a part: its alpha, or grey, says what stops light; `file` is the alpha of a glTF's own materials.
    """

    any_size: bool = False
    """Skip the check that the mesh is as large as a head: for test scenes."""
    skin: Patterns = ()
    """Parts that are skin, by name or pattern with * and ?; without it everything that neither casts nor is ignored."""
    cast: Patterns = ()
    """Parts that shadow the skin but are not baked: eyes, teeth, hair."""
    ignore: Patterns = ()
    """Parts that are as if they were not there."""
    opacity: Annotated[dict[str, str], BeforeValidator(_picture_of_all), Also("string")] = Field({}, max_length=256)
    """Picture whose alpha, or grey, stops light, for all that casts or a part each; `file` is the glTF's own alpha."""


class OccluderSpec(MeshFileSpec):
    """A file of things that shadow the skin: a hat, hair, glasses; those of its `parts` that match."""

    parts: Patterns = ("*",)
    """Parts of the file that shadow the skin, by name or pattern."""
    opacity: str | None = None
    """Picture whose alpha, or grey, stops light; `file` is the glTF's own alpha."""
