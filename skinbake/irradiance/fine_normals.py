"""Heights and repeated details as normals, so that whoever reads the normal map has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, rasterize, sample_map, shrink, uv_jacobian
from skinbake.numerics import Float, safe_div
from skinbake.scene.maps import DetailNormals, SkinMaps
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]
LOST = 1e-6  # variance of slopes that no eye sees: a roughness of 0.1 becomes 0.100005
GUTTER = 4  # texels beside the charts that get slopes as well, for whoever reads between texels


def add_fine_normals(
    maps: SkinMaps,
    mesh: SkinMesh,
    size: tuple[int, int],
    tiles: Sequence[int],
    udim: bool,
    constant_roughness: float = 0.3,
) -> SkinMaps:
    """Put what heights and details tilt into the tangent-space normal map: slopes add up.

    Parameters
    ----------
    maps : SkinMaps
    mesh : SkinMesh
        Says how many millimetres a step across the height map is.
    size : (width, height)
        Of the texture; normals get this size, or that of the normal or height map where it is larger.
    tiles : sequence of int
        UDIM tiles of the mesh.
    udim : bool
    constant_roughness : float
        Where there is no roughness map.

    Returns
    -------
    SkinMaps
        Without heights and details, `normal_strength` 1 and used up; unchanged where there is neither. Slopes of the
        detail that are finer than the texture's texels widen the oil's roughness by their variance, theory.md 6.8.

    References
    ----------
    [Olano2010]
    """
    if not maps.height_mm and maps.detail is None:
        return maps
    normal, roughness = {}, dict(maps.roughness)
    for tile in tiles:
        base, height_mm = maps.normal.get(tile), maps.height_mm.get(tile)
        shapes = [image.shape[:2] for image in (base, height_mm) if image is not None]
        shape = tuple(np.max([*shapes, size[::-1]], axis=0).tolist())
        slope = np.zeros((*shape, 2), np.float32)
        if base is not None:
            slope += np.float32(maps.normal_strength) * _bilinear(slopes_of(base), shape)
        if maps.detail is not None:
            fine, lost = _repeated(maps.detail, shape)
            slope += np.float32(maps.detail.strength) * fine
            if lost.max() > LOST:
                m = maps.roughness.get(tile, np.full((1, 1), constant_roughness, np.float32))
                m = _bilinear(m[..., None], shape)[..., 0]
                widened = np.sqrt(m * m + np.float32(maps.detail.strength) ** 2 * lost)
                roughness[tile] = np.minimum(widened, 1).astype(np.float32)
        if height_mm is not None:
            (raster,) = (r for r in rasterize(mesh, shape[::-1], GUTTER, udim) if r.tile == tile)
            slope -= _height_slopes(height_mm, mesh, raster)
        length = np.sqrt(1 + (slope * slope).sum(axis=2, keepdims=True))
        normal[tile] = np.concatenate([slope, np.ones_like(slope[..., :1])], axis=2) / length
    return replace(maps, normal=normal, normal_strength=1.0, height_mm={}, detail=None, roughness=roughness)


def slopes_of(normal: Image) -> Image:
    """x / z and y / z of tangent-space normals, (h, w, 2); 0 where a normal does not point outwards."""
    z = normal[..., 2:]
    return np.where(z > 0, normal[..., :2] / np.where(z > 0, z, np.float32(1)), np.float32(0))


def _bilinear(image: Image, shape: tuple[int, int]) -> Image:
    """An image at the texel centres of a finer one."""
    if image.shape[:2] == shape:
        return image
    row, col = np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij")
    return _at(image, row / shape[0], col / shape[1], "nearest")


def _repeated(detail: DetailNormals, shape: tuple[int, int]) -> tuple[Image, Image]:
    """Slopes of a patch that is repeated over the tile, averaged where its texels are finer than the tile's, (H, W, 2),
    and the sum of both slopes' variances that the average has lost, (H, W).
    """
    slope = slopes_of(detail.normal)
    squares = slope * slope
    (along_u, along_v), (height, width) = detail.repeat, slope.shape[:2]
    finest = max(1, round(shape[0] / along_v)), max(1, round(shape[1] / along_u))
    small = min(height, finest[0]), min(width, finest[1])
    slope, squares = shrink(slope, small), shrink(squares, small)
    lost = np.maximum((squares - slope * slope).sum(axis=2, keepdims=True), 0)
    row, col = np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij")
    # The patch's lower left corner lies at (0, 0): v grows upwards, its rows downwards
    both = np.concatenate([slope, lost], axis=2)
    read = _at(both, -(1 - row / shape[0]) * along_v, col / shape[1] * along_u, "grid-wrap")
    return read[..., :2], np.maximum(read[..., 2], 0)


def _at(image: Image, down: Float, across: Float, beyond: str) -> Image:
    """Channels of an image, read bilinearly; (0, 0) is its upper left corner and (1, 1) its lower right one."""
    from scipy.ndimage import map_coordinates

    at = np.stack([down * image.shape[0] - 0.5, across * image.shape[1] - 0.5])
    channels = [map_coordinates(image[..., k], at, order=1, mode=beyond) for k in range(image.shape[2])]
    return np.stack(channels, axis=-1)


def _height_slopes(height_mm: Image, mesh: SkinMesh, raster: AtlasRaster) -> Image:
    """Rise along the tangent and the bitangent at each texel, (H, W, 2); 0 off the charts."""
    # Across the map, per unit of u and v
    rows, cols = height_mm.shape
    per_uv = np.zeros((rows, cols, 2), np.float32)
    if cols > 1:
        per_uv[..., 0] = np.gradient(height_mm, axis=1) * cols
    if rows > 1:
        per_uv[..., 1] = np.gradient(height_mm, axis=0) * -rows
    at = sample_map(raster, mesh, {raster.tile: per_uv}, (0.0, 0.0))
    # Along the tangent t only u changes; along the bitangent, at a right angle to it, v and, on slanted charts, u
    p_u, p_v = np.moveaxis(uv_jacobian(mesh), 1, 0)
    along_u = np.linalg.norm(p_u, axis=1)
    t = safe_div(p_u, along_u[:, None])
    slant = (p_v * t).sum(axis=1)
    upright = np.linalg.norm(p_v - slant[:, None] * t, axis=1)
    by_u = safe_div(1.0, along_u)
    per_mm = np.stack([by_u, safe_div(1.0, upright), -safe_div(slant * by_u, upright)], axis=1).astype(np.float32)
    face = np.where(raster.addressed, raster.face_index, 0)
    scale = per_mm[face] * raster.addressed[..., None]
    rise_t = at[..., 0] * scale[..., 0]
    rise_b = at[..., 1] * scale[..., 1] + at[..., 0] * scale[..., 2]
    return np.stack([rise_t, rise_b], axis=-1)
