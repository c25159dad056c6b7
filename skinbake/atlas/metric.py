"""Millimetres of skin for a step in UV or across a texel; theory.md 5.3, 5.5."""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float, safe_div
from skinbake.scene.mesh import SkinMesh


def uv_jacobian(mesh: SkinMesh) -> Float:
    """P_u and P_v of each face, mm per unit of u and v, shape (F, 2, 3); zero where the UV triangle is degenerate."""
    p, uv = mesh.corner_position_mm, mesh.corner_uv
    p1, p2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    d1, d2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    twice_area = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0])[:, None]
    p_u = safe_div(d2[:, 1:] * p1 - d1[:, 1:] * p2, twice_area)
    p_v = safe_div(d1[:, :1] * p2 - d2[:, :1] * p1, twice_area)
    return np.stack([p_u, p_v], axis=1)


def first_fundamental_form(mesh: SkinMesh) -> Float:
    """e = P_u.P_u, f = P_u.P_v, h = P_v.P_v of each face, mm^2, shape (F, 3), read-only."""
    return mesh.derived(_first_fundamental_form)


def _first_fundamental_form(mesh: SkinMesh) -> Float:
    """As `first_fundamental_form`, computed."""
    jacobian = uv_jacobian(mesh)
    form: Float = np.stack(
        [np.einsum("fi,fi->f", jacobian[:, a], jacobian[:, b]) for a, b in ((0, 0), (0, 1), (1, 1))], 1
    )
    form.setflags(write=False)
    return form


def face_mm_per_texel(mesh: SkinMesh, size: tuple[int, int]) -> Float:
    """Skin length of one step along a column and along a row of each face, mm, shape (F, 2); theory.md 5.3.

    `size` is (width, height) of the texture.
    """
    form = first_fundamental_form(mesh)
    return np.sqrt(form[:, [0, 2]]) / np.asarray(size, dtype=np.float64)
