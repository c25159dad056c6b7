"""Transport: layered Monte Carlo, the truth that diffusion models approximate."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float, safe_div
from skinbake.profile.diffusion_profile import DiffusionProfile, as_radii
from skinbake.profile.fit_nodes import AnnulusNodes
from skinbake.profile.layers import Layer, without_empty
from skinbake.profile.models import media_lengths

CHUNKS = 64  # fixed, and summed in order: the result does not depend on the number of threads
ANNULI_PER_DECADE = 24
FIT_DISC = 0.1  # of the shortest free path


@dataclass(frozen=True)
class TransportProfile(DiffusionProfile):
    """Monte Carlo results per annulus, per unit flux that entered.

    Attributes
    ----------
    edge_mm : ndarray of shape (M + 1,)
        From 0 to infinity; the first annulus is a disc, the last all that is beyond.
    light : ndarray of shape (2, M, 3)
        Share of the light that leaves above, below.
    light_stderr : ndarray of shape (2, M, 3)
    total, total_error : ndarray of shape (2, 3)
        Totals above, below, and their standard errors.
    free_path_mm : float
        Shortest transport mean free path of the layers.
    unscattered, lost : ndarray of shape (3,)
        Share that left below without scattering; share still inside when its walk was cut off.
    """

    edge_mm: Float
    light: Float
    light_stderr: Float
    total: Float
    total_error: Float
    unscattered: Float
    lost: Float
    free_path_mm: float
    model: str = "transport"

    @property
    def total_reflectance(self) -> Float:
        """Share of the light that left above, shape (3,)."""
        return self.total[0]

    @property
    def total_transmittance(self) -> Float:
        """Share of the light that left below, shape (3,)."""
        return self.total[1]

    @property
    def sharp_transmittance(self) -> Float:
        """Share that crossed without scattering, shape (3,)."""
        return self.unscattered

    @property
    def total_stderr(self) -> Float:
        """Standard error of the total reflectance, shape (3,)."""
        return self.total_error[0]

    @property
    def relative_noise(self) -> Float:
        """Standard error in the norm of the fit, relative to the profile, shape (3,)."""
        nodes = self.fit_nodes()
        area = np.pi * np.diff(nodes.edge_mm**2)[:, None]
        weight = nodes.root_weight[:, None]
        noise = np.linalg.norm(weight * np.sqrt(self._seen(self.light_stderr[0] ** 2)) / area, axis=0)
        return safe_div(noise, np.linalg.norm(weight * nodes.target, axis=0))

    def reflectance(self, radius_mm: ArrayLike) -> Float:
        """R(r), interpolated between the annuli, mm^-2, shape (N, 3)."""
        return self._between(self.light[0], radius_mm)

    def transmittance(self, radius_mm: ArrayLike) -> Float:
        """T(r) without the unscattered light, interpolated between the annuli, mm^-2, shape (N, 3)."""
        scattered = self.light[1].copy()
        scattered[0] -= self.unscattered
        return self._between(np.maximum(scattered, 0), radius_mm)

    def stderr(self, radius_mm: ArrayLike) -> Float:
        """Standard error of R(r), mm^-2, shape (N, 3)."""
        return self._between(self.light_stderr[0], radius_mm)

    def _between(self, light: Float, radius_mm: ArrayLike) -> Float:
        """Values at radii from light by annulus: r^2 R, nearly even in ln r, is interpolated.

        Where R falls as 1/r, a disc's mean is R at half its radius.
        """
        radius = as_radii(radius_mm)
        edge = self.edge_mm[:-1]
        mean = light[:-1] / (np.pi * np.diff(edge**2))[:, None]
        at = np.append(edge[1] / 2, np.sqrt(edge[1:-1] * edge[2:]))
        inside = np.clip(radius, at[0], None)
        values = [np.interp(np.log(inside), np.log(at), at**2 * mean[:, c], right=0.0) for c in range(mean.shape[1])]
        return np.stack(values, axis=1) / inside[:, None] ** 2

    @property
    def footprint_mm(self) -> float:  # type: ignore[override]
        """Radius, mm, of the disc that a fit sees as one: light scattered once rises as 1/r within a free path."""
        return float(self.edge_mm[self._disc])

    @property
    def _disc(self) -> int:
        """Number of annuli inside that disc."""
        return int(np.searchsorted(self.edge_mm, FIT_DISC * self.free_path_mm))

    def _seen(self, light: Float) -> Float:
        """Light by annulus as a fit sees it: the disc as one, and without the last annulus, which has no end."""
        return np.concatenate([light[: self._disc].sum(axis=0, keepdims=True), light[self._disc : -1]])

    def fit_nodes(self) -> AnnulusNodes:
        """The disc and the annuli around it."""
        edge = np.append(0.0, self.edge_mm[self._disc : -1])
        return AnnulusNodes(edge, self._seen(self.light[0]) / (np.pi * np.diff(edge**2))[:, None], self.total[0])


def trace_layers(
    layers: Sequence[Layer], photons: int, seed: int = 0, threads: int | None = None, incidence: str = "perpendicular"
) -> TransportProfile:
    """Trace light that enters a stack of layers at a point, `photons` packets a channel; theory.md 9.1.

    Parameters
    ----------
    layers : sequence of Layer
        sigma_s = sigma_s' / (1 - g) with each layer's own g.
    photons : int
    seed : int
        The same seed gives the same result, bit for bit, on any number of threads.
    threads : int, optional
        As many as the machine has, unless given.
    incidence : "perpendicular" or "diffuse"
        A pencil beam along the normal, or light from everywhere, cosine distributed as it arrives.

    Raises
    ------
    ValueError
        If `photons` is below 1, `incidence` another word, or as `without_empty`.

    References
    ----------
    [Wang1995]
    """
    from skinbake.profile.photons import Annuli, WalkLayers, trace

    if photons < 1:
        raise ValueError(f"photons: expected at least 1, got {photons}")
    if incidence not in ("perpendicular", "diffuse"):
        raise ValueError(f"incidence: expected perpendicular or diffuse, got {incidence}")
    layers = without_empty(layers)
    shortest, longest = media_lengths(tuple(layer.medium for layer in layers))
    first, last = shortest / 50, 30 * longest
    count = int(np.ceil(np.log10(last / first) * ANNULI_PER_DECADE))
    per_log = count / np.log(last / first)
    edge = np.concatenate([[0.0], np.geomspace(first, last, count + 1), [np.inf]])
    bins = len(edge) - 1
    annuli = Annuli(float(np.log(first)), float(per_log), bins)

    face = np.concatenate([[0.0], np.cumsum([layer.thickness_mm for layer in layers])])
    index = np.array([1.0, *(layer.eta for layer in layers), 1.0])
    g = np.array([layer.g for layer in layers])
    share = np.full(CHUNKS, photons // CHUNKS)
    share[: photons % CHUNKS] += 1

    def run(task: tuple[int, int]) -> tuple[Float, Float]:
        """Tally of one channel and chunk, as `trace`."""
        channel, chunk = task
        if share[chunk] == 0:
            return np.zeros((2, 2, bins)), np.zeros(2)
        sigma_a = np.array([layer.medium.sigma_a_per_mm[channel] for layer in layers])
        sigma_s = np.array([layer.medium.sigma_sp_per_mm[channel] for layer in layers]) / (1 - g)
        stream = np.random.SeedSequence([seed, channel, chunk]).generate_state(1, np.uint64)[0]
        sigma_t = sigma_a + sigma_s
        medium = WalkLayers(face, sigma_t, sigma_s / sigma_t, g)
        result = trace(stream, share[chunk], medium, index, annuli, incidence == "diffuse")
        return result

    channels = range(len(layers[0].medium.albedo))
    tasks = [(channel, chunk) for channel in channels for chunk in range(CHUNKS)]
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        results = list(pool.map(run, tasks))

    tally = np.zeros((2, 2, bins, len(channels)))
    other = np.zeros((2, len(channels)))
    for (channel, _), (part, rest) in zip(tasks, results, strict=True):
        tally[..., channel] += part
        other[:, channel] += rest
    tally /= photons
    other /= photons
    light, squares = tally[:, 0], tally[:, 1]
    total = light.sum(axis=1)

    def error(mean: Float, square: Float) -> Float:
        """Standard error of a mean over packets, from the means of w and w^2."""
        return np.sqrt(np.maximum(square - mean**2, 0) / photons)

    return TransportProfile(
        edge, light, error(light, squares), total, error(total, squares.sum(axis=1)), other[0], other[1], shortest
    )
