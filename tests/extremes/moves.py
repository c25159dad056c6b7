"""Changes of the point of view: none may change what a bake finds."""

from __future__ import annotations

import numpy as np

from skinbake.scene.mesh import SkinMesh


def rotation(seed: int) -> np.ndarray:
    """A rotation drawn at random, (3, 3)."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q[:, ::-1]


def moved(mesh: SkinMesh, turn: np.ndarray, shift=(0.0, 0.0, 0.0), scale: float = 1.0) -> SkinMesh:
    """The mesh scaled, turned and shifted."""
    return SkinMesh(mesh.positions_mm * scale @ turn.T + shift, mesh.faces, mesh.corner_uv, mesh.corner_normal @ turn.T)


def uv_turned(mesh: SkinMesh) -> SkinMesh:
    """The same skin, its texture turned by a quarter: an image on it turns as `np.rot90` does."""
    u, v = mesh.corner_uv[..., 0], mesh.corner_uv[..., 1]
    return SkinMesh(mesh.positions_mm, mesh.faces, np.stack([1 - v, u], axis=-1), mesh.corner_normal)


def relative(got: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(got - wanted).max() / np.abs(wanted).max())
