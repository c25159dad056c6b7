import numpy as np
import pytest

from skinbake.atlas import corner_texels, interpolate, rasterize, tile_of_face, tiles_of
from skinbake.atlas.texel_coordinates import local_uv, texel_xy, texel_xy_kernel, tile_origin
from skinbake.errors import InputError
from skinbake.scene.mesh import SkinMesh
from tests.shapes import quad, sphere


@pytest.mark.parametrize("tiles", [1, 2])
def test_the_raster_and_the_corners_agree_on_where_a_uv_is(tiles):
    """Corner places interpolated by the raster are the texels' centres: odd sizes, several tiles, no axis swapped."""
    mesh, shape = sphere(90.0, "latlong", 12, tiles=tiles), (37, 53)
    for raster in rasterize(mesh, shape[::-1], gutter=0, udim=tiles > 1):
        at = interpolate(raster, corner_texels(mesh, raster.tile, shape))
        rows, cols = np.nonzero(raster.coverage == 1)
        assert len(rows) > 100
        np.testing.assert_allclose(at[rows, cols], np.stack([cols, rows], axis=1) + 0.5, atol=0.51)
        inside = raster.coverage == 1
        off = np.abs(at[inside] - np.stack([cols, rows], axis=1) - 0.5).max(axis=1)
        assert np.median(off) < 1e-4


def test_v_up_is_row_down():
    """v = 1 is the top of row 0, u = 0 the left of column 0; the kernel's formula is the same one."""
    assert texel_xy(0.0, 1.0, 37, 53) == (0.0, 0.0)
    assert texel_xy(1.0, 0.0, 37, 53) == (53.0, 37.0)
    u, v = np.random.default_rng(0).random((2, 50))
    x, y = texel_xy(u, v, 37, 53)
    assert [texel_xy_kernel(a, b, 37, 53) for a, b in zip(u, v, strict=True)] == list(zip(x, y, strict=True))


def shifted(*offsets):
    """A quad moved to several tiles, (u, v) of each."""
    one = quad(10.0, 10.0)
    uv = np.concatenate([0.1 + 0.8 * one.corner_uv + offset for offset in offsets])
    n = len(offsets)
    return SkinMesh(one.positions_mm, np.tile(one.faces, (n, 1)), uv, np.tile(one.corner_normal, (n, 1, 1)))


def test_faces_belong_to_the_tile_that_holds_their_centre():
    """Numbers run along u to ten, then up; UVs measured from a tile's corner lie in it."""
    mesh = shifted((0, 0), (9, 0), (3, 7))
    assert tile_of_face(mesh, True).tolist() == [1001, 1001, 1010, 1010, 1074, 1074]
    assert tiles_of(mesh, True) == (1001, 1010, 1074)
    assert tiles_of(mesh, False) == (1001,)
    for tile, faces in zip((1001, 1010, 1074), (slice(0, 2), slice(2, 4), slice(4, 6)), strict=True):
        local = local_uv(mesh.corner_uv[faces], tile)
        np.testing.assert_allclose(local, mesh.corner_uv[:2], atol=1e-12)
        assert tile == 1001 + tile_origin(tile)[0] + 10 * tile_origin(tile)[1]


@pytest.mark.parametrize("offset", [(-1, 0), (10, 0), (0, -1), (0, 900)])
def test_where_no_tile_is_is_refused(offset):
    """A negative u would otherwise be the last tile of the row below."""
    with pytest.raises(InputError, match="expected UVs on tiles 1001 to 9999"):
        tile_of_face(shifted((0, 0), offset), True)
