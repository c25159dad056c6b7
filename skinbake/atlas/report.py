"""Report on a mesh's UVs before baking, and the faults among it that would spoil the bake."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.connected import connected
from skinbake.atlas.metric import first_fundamental_form
from skinbake.atlas.raster import NO_FACE, Atlas
from skinbake.atlas.rasterize import signed_uv_area
from skinbake.atlas.shells import HOLLOW, ball_volume, shells_inside_out
from skinbake.atlas.texel_coordinates import corner_texels, local_uv
from skinbake.errors import InputError
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, safe_div
from skinbake.scene.mesh import SkinMesh

SPOILT_SHARE = 0.01  # of the skin's area, without a texel of its own, above which a bake is not worth starting
MOST_PAIRS = 4  # of parts that a message names
GOOD, OVERLAP, FLIPPED, OUTSIDE = 0, 1, 2, 3


@dataclass(frozen=True)
class UvReport:
    """Figures on a mesh and its UVs. Counts are triangles; shares are of the mesh's area.

    Attributes
    ----------
    extent_mm : tuple of 3 floats
    area_mm2 : float
    triangles, open_edges : int
    inside_out : bool
        The triangles turn inwards: closed by a lid over its widest opening, the mesh holds a negative volume.
    turned : int
        Triangles that turn the other way round than their neighbours, of both the smaller patch, and those of closed
        shells that face inwards.
    turned_share : float
    against : int
        Triangles whose corners' normals point to their back.
    against_share : float
    doubled : int
        Triangles that exist once more, on the same three vertices.
    doubled_share : float
    mm_per_texel : tuple of 3 floats
        Square root of the texel's area on the skin, its 5, 50 and 95 % quantiles by area.
    stretch_95 : float
        95 % quantile by area of the longest over the shortest length of a UV circle on the skin.
    coverage : float
        Share of the texture that charts cover.
    overlapping, flipped, degenerate, outside : int
        Sharing texels with another triangle; turned against the majority; without UV area though with skin; with UVs
        outside [0, 1] (or left of the UDIM tiles).
    overlapping_share : float
        Skin that has no texel of its own because another triangle shows there. Not whole triangles: charts of scans
        touch by a texel.
    degenerate_share, outside_share : float
    hidden_parts : tuple of (hidden, shown, share)
        Parts whose skin is hidden by another part's, or by their own, and the share of all skin, the largest first.
    largest_part : str
        By area.
    face_kind : ndarray of shape (F,), uint8
        GOOD, OVERLAP, FLIPPED or OUTSIDE, for a picture.
    """

    extent_mm: tuple[float, float, float]
    area_mm2: float
    triangles: int
    open_edges: int
    inside_out: bool
    turned: int
    turned_share: float
    against: int
    against_share: float
    doubled: int
    doubled_share: float
    mm_per_texel: tuple[float, float, float]
    stretch_95: float
    coverage: float
    overlapping: int
    flipped: int
    degenerate: int
    outside: int
    overlapping_share: float
    degenerate_share: float
    outside_share: float
    hidden_parts: tuple[tuple[str, str, float], ...]
    largest_part: str
    face_kind: NDArray[np.uint8]

    @property
    def faults(self) -> tuple[str, ...]:
        """Faults that would spoil a bake, each with its remedy; empty for a mesh that can be baked."""
        found = []
        if self.inside_out:
            found.append("the triangles face inwards: make them and their normals face outwards")
        if self.turned_share > SPOILT_SHARE:
            found.append(
                f"{self.turned} triangles ({self.turned_share:.1%} of the skin) turn the other way round than their"
                " neighbours, or are a shell that faces inwards, so that they are lit or seen from inside:"
                " make the mesh's faces face outwards everywhere"
            )
        elif self.against_share > SPOILT_SHARE and not self.inside_out:
            found.append(
                f"{self.against} triangles ({self.against_share:.1%} of the skin) and their normals face opposite ways,"
                " so that they are lit or seen from inside: make both face outwards"
            )
        if self.doubled_share > SPOILT_SHARE:
            found.append(
                f"{self.doubled} triangles exist twice ({self.doubled_share:.1%} of the skin), as a double-sided export"
                " writes them: export one side only, or delete the duplicates"
            )
        if self.outside_share > SPOILT_SHARE:
            found.append(
                f"{self.outside} triangles ({self.outside_share:.1%} of the skin) lie outside the texture:"
                " set texture.udim: true for UDIM tiles, or move the charts into [0, 1]"
            )
        if self.degenerate_share > SPOILT_SHARE:
            found.append(
                f"{self.degenerate} triangles ({self.degenerate_share:.1%} of the skin) have no UV area:"
                " unwrap them, or remove the UVs and set texture.unwrap: xatlas"
            )
        if self.overlapping_share > SPOILT_SHARE and self.doubled_share <= SPOILT_SHARE:
            found.append(
                f"{self.overlapping} triangles share texels with others ({self.overlapping_share:.1%} of the skin is"
                f" hidden): {self._stacked()}"
            )
        return tuple(found)

    def _stacked(self) -> str:
        """Which parts lie on one another, and what to do."""
        pairs = [(hidden, shown) for hidden, shown, share in self.hidden_parts if hidden != shown and share > 0]
        if not pairs:
            return (
                "mirrored or stacked charts cannot hold two lightings, give each its own place, or set"
                " texture.unwrap: xatlas, which lays them out anew and reads maps by the old UVs"
            )
        named = ", ".join(dict.fromkeys(f"{hidden} on {shown}" for hidden, shown in pairs[:MOST_PAIRS]))
        return (
            f"{named}: choose what is skin, such as mesh.skin: [{self.largest_part!r}], all else then casts shadows"
            " (or by mesh.cast and mesh.ignore), or give each its own place"
        )


def uv_report(mesh: SkinMesh, atlas: Atlas) -> UvReport:
    """Measure the UVs of a mesh on its atlas."""
    area, uv_area = mesh.face_area_mm2, signed_uv_area(mesh)
    total = max(float(area.sum()), 1e-300)
    height, width = atlas[0].shape
    drawn = uv_area != 0
    flipped = drawn & (np.sign(uv_area) != np.sign(uv_area[drawn].sum()))
    degenerate = ~drawn & (area > 1e-12 * total)

    outside = drawn.copy()
    overlapping, hidden = np.zeros(len(area), np.bool_), np.zeros(len(area), np.int64)
    shown = np.full(len(area), NO_FACE, np.int32)
    for raster in atlas:
        local = local_uv(mesh.corner_uv, raster.tile)
        outside &= (local < -1e-6).any(axis=(1, 2)) | (local > 1 + 1e-6).any(axis=(1, 2))
        corner_xy = corner_texels(mesh, raster.tile, raster.shape)
        found = _Overlaps(overlapping, hidden, shown)
        parallel_for(_mark_overlaps, len(corner_xy), corner_xy, drawn, raster.face_index, found)

    kind = np.full(len(area), GOOD, np.uint8)
    kind[flipped] = FLIPPED
    kind[overlapping] = OVERLAP
    kind[outside] = OUTSIDE
    e, f, h = first_fundamental_form(mesh).T
    element = np.sqrt(np.maximum(e * h - f * f, 0)) / (width * height)
    spread = np.sqrt(np.maximum((e - h) ** 2 / 4 + f * f, 0))
    stretch = np.sqrt(safe_div((e + h) / 2 + spread, np.maximum((e + h) / 2 - spread, 1e-12 * (e + h))))
    open_edges, inside_out = _closure(mesh)
    doubled, turned = _doubled(mesh), _turned(mesh)
    if not inside_out:
        turned |= shells_inside_out(mesh)
    against = np.einsum("fki,fi->f", mesh.corner_normal, mesh.face_normal) < 0
    return UvReport(
        extent_mm=tuple(float(x) for x in np.ptp(mesh.positions_mm, axis=0)),  # type: ignore[arg-type]
        area_mm2=float(area.sum()),
        triangles=len(area),
        open_edges=open_edges,
        inside_out=inside_out,
        turned=int(turned.sum()),
        turned_share=float(area[turned].sum() / total),
        against=int(against.sum()),
        against_share=float(area[against].sum() / total),
        doubled=int(doubled.sum()),
        doubled_share=float(area[doubled].sum() / total),
        mm_per_texel=tuple(_quantile(np.sqrt(element)[drawn], area[drawn], q) for q in (0.05, 0.5, 0.95)),  # type: ignore[arg-type]
        stretch_95=_quantile(stretch[drawn], area[drawn], 0.95),
        coverage=float(np.mean([raster.coverage.mean(dtype=np.float64) for raster in atlas])),
        overlapping=int(overlapping.sum()),
        flipped=int(flipped.sum()),
        degenerate=int(degenerate.sum()),
        outside=int(outside.sum()),
        overlapping_share=float((hidden * element).sum() / total),
        degenerate_share=float(area[degenerate].sum() / total),
        outside_share=float(area[outside].sum() / total),
        hidden_parts=_hidden_parts(mesh, shown, hidden * element / total),
        largest_part=mesh.part_names[np.argmax(np.bincount(mesh.part, area))] if mesh.part is not None else "",
        face_kind=kind,
    )


def report_picture(report: UvReport, atlas: Atlas) -> list[NDArray[np.uint8]]:
    """A picture of each tile, (H, W, 3): charts grey, overlaps red, flipped blue, reaching outside yellow."""
    colours = np.array([[170, 170, 170], [214, 39, 40], [31, 119, 240], [240, 190, 30]], np.uint8)
    pictures = []
    for raster in atlas:
        picture = np.full((*raster.shape, 3), 24, np.uint8)
        covered = raster.covered & (raster.face_index != NO_FACE)
        picture[covered] = colours[report.face_kind[raster.face_index[covered]]]
        pictures.append(picture)
    return pictures


def _quantile(values: Float, weights: Float, q: float) -> float:
    """Weighted quantile q of values (n,); 0 where there are none."""
    if not len(values):
        return 0.0
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order])
    return float(values[order][min(np.searchsorted(cumulative, q * cumulative[-1]), len(values) - 1)])


def _hidden_parts(mesh: SkinMesh, shown: NDArray[np.int32], share: Float) -> tuple[tuple[str, str, float], ...]:
    """Names of each hidden part and of the part that shows in its place, with the share of the skin.

    Parameters
    ----------
    mesh : SkinMesh
    shown : ndarray of shape (F,)
        A face that shows where this one is hidden, or NO_FACE.
    share : ndarray of shape (F,)
        Of the skin, that is hidden of each face.
    """
    face = np.flatnonzero(shown != NO_FACE)
    if mesh.part is None or not len(face):
        return ()
    pairs, number = np.unique(np.stack([mesh.part[face], mesh.part[shown[face]]], axis=1), axis=0, return_inverse=True)
    total = np.bincount(number.ravel(), share[face])
    return tuple(
        (mesh.part_names[pairs[k, 0]], mesh.part_names[pairs[k, 1]], float(total[k]))
        for k in np.argsort(-total, kind="stable")
    )


def _doubled(mesh: SkinMesh) -> NDArray[np.bool_]:
    """Faces beyond the first on the same three vertices, (F,)."""
    low, middle, high = np.sort(mesh.faces, axis=1).T.astype(np.int64)
    count = len(mesh.positions_mm)
    _, pair = np.unique(low * count + middle, return_inverse=True)
    _, first = np.unique(pair.ravel() * count + high, return_index=True)
    doubled = np.ones(len(mesh.faces), np.bool_)
    doubled[first] = False
    return doubled


def _turned(mesh: SkinMesh) -> NDArray[np.bool_]:
    """Faces of patches that turn the other way round than a larger neighbour, (F,).

    Two faces that turn alike go along their common edge in opposite directions.
    """
    a, b = mesh.faces.ravel().astype(np.int64), np.roll(mesh.faces, -1, axis=1).ravel().astype(np.int64)
    key = np.minimum(a, b) * len(mesh.positions_mm) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    ends = np.flatnonzero(np.diff(key[order], append=-1))
    two = ends[(np.diff(ends, prepend=-1) == 2) & (a != b)[order[ends]]]  # of just two faces
    one, other = order[two - 1], order[two]
    unlike = (a < b)[one] == (a < b)[other]
    if not unlike.any():
        return np.zeros(len(mesh.faces), np.bool_)
    patch = connected(one[~unlike] // 3, other[~unlike] // 3, len(mesh.faces))
    area = np.bincount(patch, mesh.face_area_mm2)
    first, second = patch[one[unlike] // 3], patch[other[unlike] // 3]
    smaller = np.where(area[first] < area[second], first, second)[first != second]
    return np.isin(patch, smaller)


def _closure(mesh: SkinMesh) -> tuple[int, bool]:
    """Edges with one face only, and whether the triangles turn inwards.

    A fan from the middle of the widest opening's rim to the rim closes a mask or a neck; seen from that middle, the fan
    adds nothing to the volume.
    """
    a, b = mesh.faces.astype(np.int64), np.roll(mesh.faces, -1, axis=1).astype(np.int64)
    count = len(mesh.positions_mm)
    key, uses = np.unique((np.minimum(a, b) * count + np.maximum(a, b))[a != b], return_counts=True)
    rim = key[uses == 1]
    apex = mesh.positions_mm.mean(axis=0)
    if len(rim):
        ends = np.stack([rim // count, rim % count], axis=1)
        opening = connected(ends[:, 0], ends[:, 1], count)
        middle = mesh.positions_mm[ends].mean(axis=1)
        length = np.linalg.norm(np.diff(mesh.positions_mm[ends], axis=1)[:, 0], axis=1)
        weight = np.bincount(opening[ends[:, 0]], length)
        widest = opening[ends[:, 0]] == np.argmax(weight)
        apex = np.average(middle[widest], axis=0, weights=np.maximum(length[widest], 1e-300))
    p = mesh.corner_position_mm - apex
    volume = np.einsum("ij,ij->", np.cross(p[:, 0], p[:, 1]), p[:, 2]) / 6
    return len(rim), bool(volume < -HOLLOW * ball_volume(float(mesh.face_area_mm2.sum())))


def refuse_spoilt(report: UvReport, path: str) -> None:
    """Stop before a bake that could not be used.

    Raises
    ------
    InputError
        Every fault with its remedy, a line each.
    """
    if report.faults:
        raise InputError("\n".join(f"{path}: {fault}" for fault in report.faults))


class _Overlaps(NamedTuple):
    """What is found of faces that show where others lie.

    Attributes
    ----------
    marked : ndarray of shape (F,), bool
        Faces that hide another one or are hidden.
    hidden : ndarray of shape (F,), int64
        Texels in which another face shows.
    shown : ndarray of shape (F,), int32
        A face that shows where this one is hidden.
    """

    marked: NDArray[np.bool_]
    hidden: NDArray[np.int64]
    shown: NDArray[np.int32]


@kernel
def _mark_overlaps(
    first: int,
    stop: int,
    corner_xy: Float,
    drawn: NDArray[np.bool_],
    face_index: NDArray[np.int32],
    found: _Overlaps,
) -> None:
    """Find faces that hold a texel's centre which another face shows; mark both, and count such texels by face.

    Parameters
    ----------
    first, stop : int
        Faces.
    corner_xy : ndarray of shape (F, 3, 2)
        Corners in texels, x to the right, y down.
    drawn : ndarray of shape (F,)
        Faces with UV area.
    face_index : ndarray of shape (H, W)
        Face that each texel shows.
    found : _Overlaps
        Written.
    """
    height, width = face_index.shape
    marked, hidden, shown = found.marked, found.hidden, found.shown
    for f in range(first, stop):
        if not drawn[f]:
            continue
        x0, y0 = corner_xy[f, 0, 0], corner_xy[f, 0, 1]
        x1, y1 = corner_xy[f, 1, 0], corner_xy[f, 1, 1]
        x2, y2 = corner_xy[f, 2, 0], corner_xy[f, 2, 1]
        total = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
        for row in range(max(int(min(y0, y1, y2)), 0), min(int(max(y0, y1, y2)) + 1, height)):
            for col in range(max(int(min(x0, x1, x2)), 0), min(int(max(x0, x1, x2)) + 1, width)):
                other = face_index[row, col]
                if other == f or other == NO_FACE:  # noqa: SIM109  (numba knows no `in` here)
                    continue
                x, y = col + 0.5, row + 0.5
                b1 = ((x - x0) * (y2 - y0) - (y - y0) * (x2 - x0)) / total
                b2 = ((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)) / total
                # Well inside: a centre on a shared edge belongs to both neighbours
                if b1 > 1e-6 and b2 > 1e-6 and b1 + b2 < 1 - 1e-6:
                    hidden[f] += 1
                    marked[f] = True
                    shown[f] = other
                    marked[other] = True
