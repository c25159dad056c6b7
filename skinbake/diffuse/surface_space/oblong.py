"""What classical sums of narrow lobes gain on oblong texels, taken back; theory.md 5.6.

A sum that is not divided by its weights is scaled by those of a plane. For a lobe narrower than a texel that scale is a
sum over the lattice of texels, the product of two one-dimensional sums: `lattice_gain` takes both along the shorter
side of a texel, which is right for square ones. Here the sum over each face's own lattice, sheared or not, takes its
place. The sources are texels of the full size, whatever size a target is stored at.
"""

from __future__ import annotations

import numpy as np

from skinbake.atlas import first_fundamental_form
from skinbake.diffuse.lattice import lattice_gain, lattice_table, lattice_variance
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

_WIDE = 0.9  # of a side squared: from this variance on, a sum along it is the integral to 4e-8
_REACH = 6.5  # sigma that sums go
_TURNS = 64  # more than any float needs


def oblong_gain(mesh: SkinMesh, size: tuple[int, int], variance_mm2: float) -> Float:
    """Factor on classical sums at places of each face, (F,); 1 where texels are square or the lobe is wide.

    Parameters
    ----------
    mesh : SkinMesh
    size : (height, width)
        Of the full texture.
    variance_mm2 : float
        Of the lobe, above 0.
    """
    height, width = size
    metric = first_fundamental_form(mesh) / np.array([width**2, width * height, height**2])
    gain = np.ones(len(metric))
    parallel_for(_gain_of_faces, len(metric), metric, float(variance_mm2), lattice_table(), gain)
    return gain


@kernel
def _gain_of_faces(first, stop, metric, variance, table, gain):  # type: ignore[no-untyped-def]
    """Write the factors of faces.

    Parameters
    ----------
    first, stop : int
        Faces.
    metric : ndarray of shape (F, 3)
        Products of the steps of a column and a row: e, f, h, mm^2.
    variance : float
    table : tuple
        `lattice_table()`.
    gain : ndarray of shape (F,)
    """
    for k in range(first, stop):
        e, f, h = metric[k, 0], metric[k, 1], metric[k, 2]
        area = np.sqrt(max(e * h - f * f, 0.0))
        shorter2 = min(0.5 * (e + h - np.hypot(e - h, 2.0 * f)), area)
        if not (shorter2 > 0.0 and variance < 2.0 * _WIDE * max(e, h)):
            continue
        widened = lattice_variance(variance, shorter2, table)
        # The shortest steps of the same lattice, as Gauss reduced forms
        for _ in range(_TURNS):
            if h < e:
                e, h = h, e
            turns = np.round(f / e)
            if turns == 0.0:
                break
            f, h = f - turns * e, h - 2.0 * turns * f + turns * turns * e
        apart2 = h - f * f / e
        if widened >= _WIDE * e and widened >= _WIDE * apart2:
            total = 2.0 * np.pi * widened / area
        else:
            total = 0.0
            rows = int(np.ceil(_REACH * np.sqrt(widened / apart2)))
            for n in range(-rows, rows + 1):
                total += np.exp(-n * n * apart2 / (2.0 * widened)) * _sum_along(widened / e, f / e * n)
        want = 2.0 * np.pi * variance / (area * total)
        gain[k] = want / lattice_gain(variance, shorter2, table)


@kernel
def _sum_along(t, offset):  # type: ignore[no-untyped-def]
    """sum_m exp(-(m + offset)^2 / 2t)."""
    if t >= _WIDE:
        return np.sqrt(2.0 * np.pi * t)
    nearest = -np.round(offset)
    total, reach = 0.0, int(np.ceil(_REACH * np.sqrt(t))) + 1
    for m in range(-reach, reach + 1):
        total += np.exp(-((nearest + m + offset) ** 2) / (2.0 * t))
    return total
