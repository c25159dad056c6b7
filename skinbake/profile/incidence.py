"""How much of light that enters at a slant comes back: R(mu). A profile knows a beam along the normal only."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.chandrasekhar import half_space_diffuse_reflectance, half_space_reflectance
from skinbake.profile.layers import Layer, without_empty
from skinbake.profile.slab_transport import diffuse_mean
from skinbake.profile.stack_transport import stack_reflectance

NODES = 33  # cosines 0, 1/32, ... 1, between which R(mu) is linear
CHUNKS = 16  # fixed, and averaged in order: the result does not depend on the number of threads
WALKS = 64_000  # a channel: R(mu) to 0.3 %, ratios of it to less


@dataclass(frozen=True)
class Incidence:
    """Reflected share by slant, per unit of light that entered.

    Attributes
    ----------
    cosine : ndarray of shape (NODES,)
        Of incidence, outside; ascending from 0 to 1.
    reflectance_rgb : ndarray of shape (NODES, 3)
    diffuse_rgb : ndarray of shape (3,)
        Of light from everywhere: 2 int R(mu) mu dmu.
    """

    cosine: Float
    reflectance_rgb: Float
    diffuse_rgb: Float


def reflect_slanted(
    layers: Sequence[Layer], walks: int = WALKS, seed: int = 0, threads: int | None = None
) -> Incidence:
    """R(mu) of a stack of layers; theory.md 9.5.

    In closed form for one semi-infinite layer of isotropic scattering whose index is that of the outside (theory.md
    9.4), by doubling for others that scatter to all sides alike, else by walks.

    Parameters
    ----------
    layers : sequence of Layer
        Of one index; sigma_s = sigma_s' / (1 - g) with each layer's own g.
    walks : int
        A channel, where there are walks.
    seed : int
        The same seed gives the same table, bit for bit, on any number of threads.
    threads : int, optional

    Raises
    ------
    ValueError
        If the layers' indices differ, `walks` is below 1, or as `without_empty`.

    References
    ----------
    [Chandrasekhar1960], [Wang1995]
    """
    if walks < 1:
        raise ValueError(f"walks: expected at least 1, got {walks}")
    layers = without_empty(layers)
    eta = layers[0].eta
    if any(layer.eta != eta for layer in layers):
        raise ValueError(f"layers: expected one index, got {', '.join(f'{layer.eta:g}' for layer in layers)}")
    cosine = np.linspace(0, 1, NODES)
    first = layers[0]
    if (
        len(layers) == 1
        and np.isinf(first.thickness_mm)
        and eta == 1
        and first.g == 0
        and first.medium.albedo.max() < 1
    ):
        albedo = first.medium.albedo
        return Incidence(
            cosine, half_space_reflectance(cosine[:, None], albedo), half_space_diffuse_reflectance(albedo)
        )
    if eta >= 1 and not any(layer.g for layer in layers):
        reflectance = np.clip(stack_reflectance([layers], cosine)[0], 0, 1)
    else:
        reflectance = _walk(layers, eta, cosine[1:], walks, seed, threads)
        # Grazing light: continued from the last two cosines, for no beam gets in there
        grazing = 2 * reflectance[0] - reflectance[1]
        reflectance = np.clip(np.concatenate([grazing[None], reflectance]), 0, 1)
    return Incidence(cosine, reflectance, diffuse_mean(cosine, reflectance))


def _walk(layers: tuple[Layer, ...], eta: float, cosine: Float, walks: int, seed: int, threads: int | None) -> Float:
    """R at cosines above 0, (K, 3)."""
    from skinbake.profile.incidence_walk import reflect_beams
    from skinbake.profile.photons import WalkLayers

    face = np.concatenate([[0.0], np.cumsum([layer.thickness_mm for layer in layers])])
    g = np.array([layer.g for layer in layers])
    cos_inside = np.sqrt(1 - (1 - cosine**2) / eta**2)
    channels = len(layers[0].medium.albedo)

    def run(task: tuple[int, int]) -> Float:
        channel, chunk = task
        sigma_a = np.array([layer.medium.sigma_a_per_mm[channel] for layer in layers])
        sigma_s = np.array([layer.medium.sigma_sp_per_mm[channel] for layer in layers]) / (1 - g)
        stream = np.random.SeedSequence([seed, channel, chunk]).generate_state(1, np.uint64)[0]
        sigma_t, out = sigma_a + sigma_s, np.empty(len(cosine))
        medium = WalkLayers(face, sigma_t, sigma_s / sigma_t, g)
        reflect_beams(stream, -(-walks // CHUNKS), medium, eta, cos_inside, out)
        return out

    tasks = [(channel, chunk) for channel in range(channels) for chunk in range(CHUNKS)]
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        found = np.array(list(pool.map(run, tasks)))
    return found.reshape(channels, CHUNKS, -1).mean(axis=1).T
