"""Light upstream of each place of the skin, a free path along the tangent: across the texture, or by rays down to it.

Upstream is found across the texture where that leads to the place that was meant, with rays down to the skin elsewhere.
"""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, uv_jacobian
from skinbake.atlas.raster import NO_FACE
from skinbake.atlas.sample import bilinear, texels_around
from skinbake.diffuse.terms.skin_hits import NOTHING, TexturedSkin
from skinbake.irradiance.punctual_light import emitter, towards
from skinbake.irradiance.shadow_origin import facet_point
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
from skinbake.scene.lights import LightSpec

Image = NDArray[np.float32]
Index = NDArray[np.int64]
DROP = 1.0  # of the shift, by which the skin there may lie off the tangent plane
LEAST_SPREAD = 0.5  # of an area: deeper hollows than that would have the beam meet itself
TURNS = 3  # steps across the texture towards the place


class BeamShift:
    """Reads light upstream of a tile's texels.

    Parameters
    ----------
    raster : AtlasRaster
    skin : TexturedSkin
    number : int
        Place of the tile in the atlas.
    free_path_mm : ndarray of shape (3,)
    eta : float
    curvature_per_mm : ndarray of shape (h, w, 3), optional
        Mean curvature of the tile by channel, of any size, where what it makes of lobes is counted (theory.md 9.8): a
        beam that enters round skin is spread over more of it further along.
    """

    def __init__(
        self,
        raster: AtlasRaster,
        skin: TexturedSkin,
        number: int,
        free_path_mm: Float,
        eta: float,
        curvature_per_mm: Image | None = None,
    ) -> None:
        height, width = raster.shape
        self._curvature = curvature_per_mm
        self._raster, self._skin, self._number = raster, skin, number
        self._reach_mm = free_path_mm / eta
        self._looked: dict[str, tuple[Image, Image]] = {}
        self._corner = np.ascontiguousarray(skin.mesh.corner_position_mm - skin.occluder.centre_mm)
        # A step of one column is du = 1 / width, of one row dv = -1 / height
        self._step = np.ascontiguousarray(uv_jacobian(skin.mesh) * np.array([1 / width, -1 / height])[:, None])

    def read(self, light: LightSpec, image: Image, rows: Index | None = None) -> Image:
        """Light upstream, shape (rows, W, 3); where no skin is found upstream, the light that is there.

        Parameters
        ----------
        light : LightSpec
            With one direction (`has_beam`).
        image : ndarray of shape (H, W, 3)
            Its light.
        rows : ndarray, optional
            Of the texture; all of them by default.
        """
        rows, out = (np.arange(len(image)), image.copy()) if rows is None else (rows, image[rows])
        self._read(light, image, rows, out)
        return self._spread(light, rows, out)

    def looked_at(self, light: LightSpec, image: Image, rows: Index, room: Image) -> tuple[Image, Image]:
        """Light of some rows, and what `read` gives there, both (rows, W, 3); read once of a light of a name.

        Parameters
        ----------
        light : LightSpec
        image : ndarray of shape (H, W, 3)
            Which may be halves.
        rows : ndarray
            The same at each call.
        room : ndarray of shape (H, W, 3), float32
            Written, where the light is not known yet: fresh memory for each light takes more than what is done here.
        """
        if light.name not in self._looked:
            np.copyto(room, image)
            here, upstream = room[rows], room[rows]
            self._read(light, room, rows, upstream)
            self._looked[light.name] = here, upstream
        here, upstream = self._looked[light.name]
        return here, self._spread(light, rows, upstream.copy())

    def curved(self, curvature_per_mm: Image | None) -> BeamShift:
        """The same on skin of a curvature, with what was looked at."""
        other = copy(self)
        other._curvature = curvature_per_mm
        return other

    def _read(self, light: LightSpec, image: Image, rows: Index, out: Image) -> None:
        """Write light upstream as on a plane, where it is found."""
        source = emitter(light, self._skin.occluder.centre_mm)
        lost = np.zeros((len(rows), image.shape[1]), np.bool_)
        parallel_for(_read_upstream, len(rows), rows, self._skin_under(source), self._step, image, _Upstream(out, lost))
        at = np.argwhere(lost)
        if len(at):
            self._read_by_rays(source, rows, at, image, out)

    def _spread(self, light: LightSpec, rows: Index, out: Image) -> Image:
        """What curvature makes of light upstream, in place."""
        if self._curvature is not None:
            source = emitter(light, self._skin.occluder.centre_mm)
            parallel_for(_spread, len(rows), rows, self._skin_under(source), self._curvature, out)
        return out

    def _skin_under(self, source: Float) -> _LitSkin:
        """The tile's skin and a light, as kernels take them."""
        return _LitSkin(*self._raster.shown, self._corner, self._skin.mesh.corner_normal, source, self._reach_mm)

    def _read_by_rays(self, source: Float, rows: Index, at: Index, image: Image, out: Image) -> None:
        """Write the light that rays find upstream of some texels."""
        origin, down = np.empty((len(at), 3, 3), np.float32), np.empty((len(at), 3, 3), np.float32)
        parallel_for(
            _aim_upstream,
            len(at),
            (rows[at[:, 0]], np.ascontiguousarray(at[:, 1])),
            self._skin_under(source),
            origin,
            down,
        )
        tile, texel = self._skin.met_by(origin.reshape(-1, 3), down.reshape(-1, 3))
        found = ((texel != NOTHING) & (tile == self._number)).reshape(-1, 3)
        flat = image.reshape(-1, 3)
        for c in range(3):
            mine = np.flatnonzero(found[:, c])
            out[at[mine, 0], at[mine, 1], c] = flat[texel.reshape(-1, 3)[mine, c], c]


class _LitSkin(NamedTuple):
    """Skin of a tile under a light.

    Attributes
    ----------
    face_index, barycentric : ndarrays of shape (H, W), (H, W, 2)
        As in `ShownFaces`.
    corner, normals : ndarrays of shape (F, 3, 3)
        Positions about the rays' centre, mm, and normals.
    source : ndarray of shape (10,)
        As `emitter` makes it.
    reach_mm : ndarray of shape (3,)
        Free path over index.
    """

    face_index: NDArray[np.int32]
    barycentric: Image
    corner: Float
    normals: Float
    source: Float
    reach_mm: Float


class _Upstream(NamedTuple):
    """What is found upstream of the texels of R rows.

    Attributes
    ----------
    out : ndarray of shape (R, W, 3)
        Light, where a place was found.
    lost : ndarray of shape (R, W), bool
        Where none was.
    """

    out: Image
    lost: NDArray[np.bool_]


@kernel(inline=True)
def _tangent(source, px, py, pz, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Part of the unit direction to a light in the tangent plane."""
    lx, ly, lz, _, _ = towards(source, px, py, pz)
    along = lx * nx + ly * ny + lz * nz
    return lx - along * nx, ly - along * ny, lz - along * nz


@kernel(inline=True)
def _unit_normal(normals, face, b1, b2):  # type: ignore[no-untyped-def]
    """Unit normal of the smooth surface at a place in a face."""
    x, y, z = facet_point(normals, face, b1, b2)
    length = max(np.sqrt(x * x + y * y + z * z), 1e-30)
    return x / length, y / length, z / length


@kernel
def _read_upstream(first, stop, rows, skin, step, image, upstream):  # type: ignore[no-untyped-def]
    """Light upstream of each texel of some rows, found across the texture.

    Parameters
    ----------
    first, stop : int
        Which of the rows.
    rows : ndarray of shape (R,)
    skin : _LitSkin
    step : ndarray of shape (F, 2, 3)
        Skin of one column and of one row, mm.
    image : ndarray of shape (H, W, 3)
    upstream : _Upstream
        Written.
    """
    face_index, barycentric, corner, normals = skin.face_index, skin.barycentric, skin.corner, skin.normals
    source, reach_mm, out, lost = skin.source, skin.reach_mm, upstream.out, upstream.lost
    height, width = face_index.shape
    longest = max(reach_mm[0], reach_mm[1], reach_mm[2])
    for k in range(first, stop):
        row = rows[k]
        for col in range(width):
            face = face_index[row, col]
            if face == NO_FACE:
                continue
            b1, b2 = np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
            px, py, pz = facet_point(corner, face, b1, b2)
            nx, ny, nz = _unit_normal(normals, face, b1, b2)
            tx, ty, tz = _tangent(source, px, py, pz, nx, ny, nz)
            sx, sy, sz = longest * tx, longest * ty, longest * tz
            shift2 = sx * sx + sy * sy + sz * sz
            x, y = np.float64(col), np.float64(row)
            at_col, at_row = col, row
            found = False
            for _ in range(TURNS):
                # From the texel at hand to the place, in texels of its face
                u, v = step[face, 0], step[face, 1]
                uu, uv, vv = u[0] * u[0] + u[1] * u[1] + u[2] * u[2], 0.0, 0.0
                for axis in range(3):
                    uv += u[axis] * v[axis]
                    vv += v[axis] * v[axis]
                det = uu * vv - uv * uv
                if not det > 1e-12 * uu * vv:
                    break
                qx, qy, qz = facet_point(corner, face, b1, b2)
                rx, ry, rz = px + sx - qx, py + sy - qy, pz + sz - qz
                ru, rv = rx * u[0] + ry * u[1] + rz * u[2], rx * v[0] + ry * v[1] + rz * v[2]
                dx, dy = (vv * ru - uv * rv) / det, (uu * rv - uv * ru) / det
                x, y = at_col + dx, at_row + dy
                # What is left of the way lies off the tangent plane there
                ox = rx - dx * u[0] - dy * v[0]
                oy = ry - dx * u[1] - dy * v[1]
                oz = rz - dx * u[2] - dy * v[2]
                if max(abs(dx), abs(dy)) <= 1.0:
                    found = ox * ox + oy * oy + oz * oz <= DROP * DROP * shift2 + 1e-12
                    break
                if not (-0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5):
                    break
                at_col, at_row = int(x + 0.5), int(y + 0.5)
                face = face_index[at_row, at_col]
                if face == NO_FACE:
                    break
                b1, b2 = np.float64(barycentric[at_row, at_col, 0]), np.float64(barycentric[at_row, at_col, 1])
            if not found:
                lost[k, col] = True
                continue
            for c in range(3):
                part = reach_mm[c] / longest
                cx, cy = col + part * (x - col), row + part * (y - row)
                x0, y0 = int(np.floor(cx)), int(np.floor(cy))
                fx, fy = cx - x0, cy - y0
                total, weight = 0.0, 0.0
                for i in range(2):
                    for j in range(2):
                        r, q = y0 + i, x0 + j
                        if r < 0 or q < 0 or r >= height or q >= width or face_index[r, q] == NO_FACE:
                            continue
                        w = (fy if i else 1.0 - fy) * (fx if j else 1.0 - fx)
                        total += w * image[r, q, c]
                        weight += w
                if weight > 1e-3:
                    out[k, col, c] = total / weight


@kernel
def _spread(first, stop, rows, skin, curvature, out):  # type: ignore[no-untyped-def]
    """Divide light by what its shift makes of an area: 1 + the divergence of the shift, twice the mean curvature times
    the cosine of incidence times its reach.

    Parameters
    ----------
    first, stop : int
        Which of the rows.
    rows : ndarray of shape (R,)
    skin : _LitSkin
    curvature : ndarray of shape (h, w, 3)
    out : ndarray of shape (R, W, 3), changed in place
    """
    height, width = skin.face_index.shape
    h, w = curvature.shape[:2]
    for k in range(first, stop):
        row = rows[k]
        for col in range(width):
            face = skin.face_index[row, col]
            if face == NO_FACE:
                continue
            b1, b2 = np.float64(skin.barycentric[row, col, 0]), np.float64(skin.barycentric[row, col, 1])
            px, py, pz = facet_point(skin.corner, face, b1, b2)
            nx, ny, nz = _unit_normal(skin.normals, face, b1, b2)
            lx, ly, lz, _, _ = towards(skin.source, px, py, pz)
            cosine = lx * nx + ly * ny + lz * nz
            if cosine <= 0.0:
                continue
            around = texels_around((col + 0.5) / width, 1.0 - (row + 0.5) / height, h, w)
            for c in range(3):
                more = 2.0 * bilinear(curvature, c, around) * cosine * skin.reach_mm[c]
                out[k, col, c] /= np.float32(max(1.0 + more, LEAST_SPREAD))


@kernel
def _aim_upstream(first, stop, texels, skin, origin, down):  # type: ignore[no-untyped-def]
    """Rays down to the skin upstream of texels, one a channel, written.

    Parameters
    ----------
    first, stop : int
        Which of the texels.
    texels : tuple of two ndarrays of shape (n,)
        Rows and columns.
    skin : _LitSkin
    origin, down : ndarrays of shape (n, 3, 3)
    """
    rows, cols = texels
    face_index, barycentric, corner, normals = skin.face_index, skin.barycentric, skin.corner, skin.normals
    source, reach_mm = skin.source, skin.reach_mm
    for k in range(first, stop):
        face = face_index[rows[k], cols[k]]
        b1, b2 = np.float64(barycentric[rows[k], cols[k], 0]), np.float64(barycentric[rows[k], cols[k], 1])
        px, py, pz = facet_point(corner, face, b1, b2)
        nx, ny, nz = _unit_normal(normals, face, b1, b2)
        tx, ty, tz = _tangent(source, px, py, pz, nx, ny, nz)
        for c in range(3):
            origin[k, c, 0] = px + reach_mm[c] * (tx + nx)
            origin[k, c, 1] = py + reach_mm[c] * (ty + ny)
            origin[k, c, 2] = pz + reach_mm[c] * (tz + nz)
            down[k, c, 0], down[k, c, 1], down[k, c, 2] = -nx, -ny, -nz
