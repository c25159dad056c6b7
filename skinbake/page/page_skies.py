"""Our own skies on a bake's transfer, as a page shows them: its textures, and how much of each a turned sky needs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from skinbake.io.bake_folder import BakeFolder, read_relit_folder
from skinbake.numerics import Float
from skinbake.page.coded_image import CodedImage, coded
from skinbake.preview.mode import Mode
from skinbake.preview.relit import LaterLight
from skinbake.preview.scene import Texture
from skinbake.preview.shader_defines import shader_defines
from skinbake.preview.shader_light import ShaderLight
from skinbake.relight.basis import LightBasis
from skinbake.relight.grey_lights import texture_gains
from skinbake.relight.relit import relit
from skinbake.relight.skies import made_sky, sky_names

LARGEST_BYTES = 20_000_000  # of a page
_REST_BYTES = 200_000  # of its scripts, and of the skies' coefficients


class PageSkies(NamedTuple):
    """What a page needs to show skies.

    Attributes
    ----------
    skies : list of dict
        `name`, and `turn`: coefficients (2 N + 1, 3 K) of 1, cos a, sin a, ... cos N a, sin N a for a turn by a.
    tiles : dict of int to dict
        By tile: `textures` of the basis and shader symbols `defines`.
    rms : float
        Error of the coding, of the light that leaves, relative to that; the largest of tiles and skies.
    """

    skies: list[dict[str, Any]]
    tiles: dict[int, dict[str, Any]]
    rms: float


def page_skies(bake: BakeFolder, lights: tuple[ShaderLight, ...], taken: int) -> PageSkies | None:
    """Skies of a bake with `relight`; None where their textures do not fit.

    Parameters
    ----------
    bake : BakeFolder
    lights : tuple of ShaderLight
        Of the page, whose uniforms the sky's shader shares.
    taken : int
        Characters of the page without them.

    Raises
    ------
    InputError
        A file of the transfer is missing or damaged.
    """
    scene = read_relit_folder(bake.path).scene
    basis = scene.basis
    assert basis is not None  # of a scene for lights that come later
    light = {name: LaterLight(made_sky(name)) for name in sky_names()}
    amounts = [each.coefficients(basis) for each in light.values()]
    lobe, room = scene.lobes[0].rgb, LARGEST_BYTES - _REST_BYTES - taken
    images = _coded(lobe, room)
    if images is None:
        return None
    tiles = {
        number: {
            "textures": [image.record for image in images[number]],
            "defines": shader_defines(scene, number, Mode("diffuse"), lights, len(basis)),
        }
        for number in lobe
    }
    rms = max(_relative_rms(lobe[number], images[number], basis, amount) for number in lobe for amount in amounts)
    return PageSkies([{"name": name, "turn": _turn(each, basis)} for name, each in light.items()], tiles, rms)


def _coded(tiles: Mapping[int, Texture], room: int) -> dict[int, list[CodedImage]] | None:
    """Textures by tile in 8 bits; None as soon as they take more than `room` characters.

    Without further loss: errors of textures that nearly cancel add up. WebP's own would put half of the pixels of a
    head under a low sun off by more than 2 of 255.
    """
    found: dict[int, list[CodedImage]] = {number: [] for number in tiles}
    for number, textures in tiles.items():
        for texture in textures:
            image = coded(texture, "linear", lossless=True)
            found[number].append(image)
            room -= len(image.record["data"])
            if room < 0:
                return None
    return found


def _turn(light: LaterLight, basis: LightBasis) -> list[list[float]]:
    """Fourier series of a light's coefficients over its turn, which has no terms above the order of the harmonics."""
    count = 2 * basis.order + 1
    turned = np.stack([light.turned(360 * i / count).coefficients(basis).reshape(-1) for i in range(count)])
    series = np.fft.rfft(turned, axis=0) / count
    rows = [series[0].real]
    for term in series[1:]:
        rows += [2 * term.real, -2 * term.imag]
    return [[float(f"{x:.6g}") for x in row] for row in rows]


def _relative_rms(textures: Texture, images: list[CodedImage], basis: LightBasis, amount: Float) -> float:
    """Error of the coding of a sum of textures, relative to it; errors of two textures have nothing in common.

    Of grey lights, the mean tint's, whose own error is left out: it is small beside what they are.
    """
    coloured, grey = texture_gains(basis, amount)
    squares = [*(coloured**2).mean(axis=1), *(grey**2).sum(axis=1).mean(axis=1)]
    wrong = sum(square * image.rms**2 for square, image in zip(squares, images, strict=True))
    whole = np.mean(relit(textures, basis, amount) ** 2, dtype=np.float64)
    return float(np.sqrt(wrong / max(float(whole), 1e-30)))
