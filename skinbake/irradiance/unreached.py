"""Lights that reach no skin, and why: slips of a sign, a unit or an order that a picture shows only as darkness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.punctual_light import NEAREST_MM, colour, emitter
from skinbake.irradiance.surface import scattered_origins
from skinbake.numerics import Float, normalized
from skinbake.scene.lights import DirectionalLight, EnvironmentLight, LightSpec, RectangleLight, SpotLight
from skinbake.scene.mesh import SkinMesh

POINTS = 4000  # of the skin
FAINT = 1e-4  # of what the brightest light brings: nothing that a picture shows


def unreached(
    lights: Sequence[LightSpec],
    mesh: SkinMesh,
    size: tuple[int, int],
    skies: Mapping[str, NDArray[np.float32]],
    shadows: bool = True,
) -> list[str]:
    """A sentence on each light that lights no skin, or next to none.

    Parameters
    ----------
    lights : sequence of LightSpec
    mesh : SkinMesh
    size : (width, height)
        Of the texture.
    skies : mapping of str to ndarray of shape (h, w, 3)
        By the name of their light.
    shadows : bool
        Of the look.
    """
    occluder = Occluder(mesh)
    origin, normal = scattered_origins(mesh, occluder, size, POINTS)
    point = origin.astype(np.float64) + occluder.centre_mm
    outwards: Float = normal.astype(np.float64)
    found, most = {}, {}
    for light in lights:
        if isinstance(light, EnvironmentLight):
            radiance = skies[light.name].max() if light.name in skies else max(light.radiance or (0.0,))
            most[light.name] = float(radiance) * light.scale * np.pi
            why = "it is black"
        elif not light.everywhere:
            arriving, why = (
                _rectangle(light, point, outwards)
                if isinstance(light, RectangleLight)
                else _punctual(light, point, outwards)
            )
            lit = np.flatnonzero(arriving > 0)
            if len(lit) and mesh.casters is not None and light.casts(shadows):
                to_light = _middle(light, point[lit]) - point[lit]
                blocked = occluder.occluded(
                    origin[lit], to_light.astype(np.float32), np.full(len(lit), 1 - 1e-4, np.float32)
                )
                arriving[lit[blocked]] = 0
                why = "what casts shadows stands in its way everywhere; check mesh.cast and occluders"
            most[light.name] = float(arriving.max())
        if most.get(light.name, 1.0) <= 0:
            found[light.name] = why
    brightest = max(most.values(), default=0.0)
    for name, value in most.items():
        if 0 < value < FAINT * brightest:
            found[name] = f"at most {value / brightest:.1g} of the brightest light; are its position and power in mm?"
    return [f"light {name}: reaches no skin: {why}" for name, why in found.items()]


def _middle(light: LightSpec, point: Float) -> Float:
    """Where rays to a light end: its middle, or far away."""
    if isinstance(light, DirectionalLight):
        far_mm = 10 * float(np.abs(point).max() + 1000)
        away: Float = far_mm * normalized(np.asarray(light.direction, np.float64))
        return point - away
    middle = np.asarray(light.position_mm, np.float64)  # type: ignore[union-attr]
    return np.broadcast_to(middle, point.shape)


def _punctual(light: LightSpec, point: Float, normal: Float) -> tuple[Float, str]:
    """Irradiance at points (n,), its brightest channel, and why there is none; theory.md 10.1."""
    source, rgb = emitter(light, np.zeros(3)), float(colour(light).max())
    if isinstance(light, DirectionalLight):
        cosine = np.maximum(normal @ source[1:4], 0)
        return rgb * cosine, _black(rgb) or "all skin faces away; direction is where the light travels to"
    way = source[1:4] - point
    distance = np.maximum(np.linalg.norm(way, axis=1), NEAREST_MM)
    cosine = np.maximum((normal * way).sum(axis=1) / distance, 0)
    arriving = rgb * cosine / distance**2
    why = "all skin faces away from position_mm, as it does where a light stands inside the head"
    if isinstance(light, SpotLight) and arriving.max() > 0:
        inside = (-(way / distance[:, None]) @ source[4:7]) > source[8]
        arriving = arriving * inside
        why = "its cone passes by; axis is the way in which it shines, outer_deg half of the cone's angle"
    return arriving, _black(rgb) or why


def _rectangle(light: RectangleLight, point: Float, normal: Float) -> tuple[Float, str]:
    """About the irradiance at points (n,) by five places of a rectangle, and why there is none."""
    middle, along = np.asarray(light.position_mm, np.float64), np.asarray(light.edge_u_mm, np.float64)
    across = np.asarray(light.edge_v_mm, np.float64)
    area = np.cross(along, across)
    arriving, in_front = np.zeros(len(point)), False
    for u, v in ((0, 0), (0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5)):
        way = middle + u * along + v * across - point
        squared = np.maximum((way * way).sum(axis=1), NEAREST_MM**2)
        sent, got = np.maximum(-(way @ area), 0), np.maximum((way * normal).sum(axis=1), 0)
        in_front |= bool((sent > 0).any())
        arriving += max(light.radiance) * sent * got / squared**2 / 5
    side = ", ".join(f"{x:.3g}" for x in normalized(area))
    why = (
        "all skin faces away from it"
        if in_front
        else f"it shines the other way, to the side of cross(edge_u_mm, edge_v_mm), [{side}]; swap the two edges"
    )
    return arriving, _black(max(light.radiance)) or why


def _black(most: float) -> str:
    return "" if most > 0 else "it is black"
