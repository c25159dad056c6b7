"""What the oil mirrors of a sky: a few directions, chosen so that none burns out at the rim.

Towards grazing the lobe of the oil is steep and high, and a sum over directions that chance puts there is anything. So
the sky is parted in two. What is no brighter than `DIM` times its mean is cut into even parts: a texel mirrors their
mean, weighed by the lobe, times all that the lobe sends back, A(N.V, m). That is exact for a sky that is the same
everywhere, and never more than its brightest part. What is brighter (a sun, a soft box) is drawn in proportion to its
radiance and summed up, but sends back no more than the lobe can. `skin.frag` does the same.
"""

from __future__ import annotations

import numpy as np

from skinbake.irradiance.environment_map import Image, SkySamples, direction_of
from skinbake.irradiance.sky_directions import all_around
from skinbake.numerics import Float, safe_div

DIM = 2.0  # times the mean radiance
ROWS = 64  # of the sky that is cut into parts
NEGLIGIBLE = 1e-6  # of the sky's light: no directions are spent on it
_UNIFORM = 1e-6  # share of the bright part's directions that fall anywhere: no texel has none


def mirrored_sky(radiance: Image, count: int) -> Image:
    """Directions of a sky, (n, 2, 4): unit vector and the part of the sphere it stands for; radiance, and 1 if bright.

    Parameters
    ----------
    radiance : ndarray of shape (h, w, 3)
        Equirectangular.
    count : int
        Of directions, half of them for what is bright, where there is anything.
    """
    height, width = radiance.shape[:2]
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    solid = (2 * np.pi / width) * (edges[:-1] - edges[1:])
    luminance = radiance.mean(axis=2, dtype=np.float32)
    mean = float((luminance.mean(axis=1, dtype=np.float64) * solid).sum() / solid.sum())
    share = np.minimum(1, safe_div(np.float32(DIM * mean), luminance)) if mean > 0 else np.ones_like(luminance)
    dim = radiance * share.astype(np.float32)[..., None]
    bright = radiance - dim
    flux = float((bright.mean(axis=(1, 2), dtype=np.float64) * solid).sum())
    drawn = count // 2 if flux > NEGLIGIBLE * mean * solid.sum() else 0
    found = [_rows(*_even_parts(dim, count - drawn), 0.0)]
    if drawn:
        towards, of, part = SkySamples(bright, uniform=_UNIFORM).draw_parts(drawn)
        found.append(_rows(towards, part, of, 1.0))
    return np.concatenate(found)


def _rows(towards: Image | Float, part: Float, radiance: Image | Float, bright: float) -> Image:
    """Directions in the order in which the shader reads them."""
    out = np.full((len(towards), 2, 4), bright, np.float32)
    out[:, 0, :3], out[:, 0, 3], out[:, 1, :3] = towards, part, radiance
    return out


def _even_parts(radiance: Image, count: int) -> tuple[Float, Float, Float]:
    """Even directions, the part of the sphere about each, and the mean radiance there.

    Parameters
    ----------
    radiance : ndarray of shape (h, w, 3)
    count : int
    """
    towards = all_around(count)
    step = max(1, len(radiance) // ROWS)
    height, width = (side // step * step for side in radiance.shape[:2])
    blocks = radiance[:height, :width].reshape(height // step, step, width // step, step, 3)
    small = blocks.mean(axis=(1, 3), dtype=np.float64)
    rows, columns = small.shape[:2]
    finer = -(-ROWS // rows)
    small = np.repeat(np.repeat(small, finer, axis=0), finer, axis=1)
    rows, columns = small.shape[:2]
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, 1 - (np.arange(rows) + 0.5) / rows)
    edges = np.cos(np.pi * np.arange(rows + 1) / rows)
    solid = np.repeat((2 * np.pi / columns) * (edges[:-1] - edges[1:]), columns)
    nearest = (direction_of(u, v).reshape(-1, 3) @ towards.T).argmax(axis=1)
    part = np.bincount(nearest, solid, count).astype(np.float64)
    sums = [np.bincount(nearest, solid * small[..., c].reshape(-1), count) for c in range(3)]
    return towards, part, safe_div(np.stack(sums, axis=1), part[:, None])
