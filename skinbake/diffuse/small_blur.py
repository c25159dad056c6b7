"""Blurs light that is smooth and small beside the rest, at few texels, by the same lobes as the rest.

So that the skin sends back the same share of it, spread as widely: what is added unblurred where light gathers would
make more leave there than arrives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skinbake.atlas import Atlas, Tiles
from skinbake.diffuse.diffuse_map import Lobe
from skinbake.diffuse.draw_probes import draw_probes
from skinbake.diffuse.make_lobes import make_lobes
from skinbake.diffuse.memoize import Memoizer
from skinbake.diffuse.methods import IDENTITY, METHODS, DiffusionMethod, LobeParameters, LobePlan
from skinbake.diffuse.planning.fixed import plan_lobe
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.skin_geometry import SkinGeometry
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.diffuse.terms.diffuse_profile import EverywhereLight
from skinbake.profile import GaussianSum
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import DiffusionSpec

TOLERANCE = 0.05  # of light that is a few per cent of all
LEAST_TEXELS2 = 0.25  # variance of a lobe below which reading such texels bilinearly blurs by more than it


class SmallBlur:
    """Lobes at the texels of a small atlas.

    Parameters
    ----------
    atlas : Atlas
        The small one.
    mesh : SkinMesh
    gaussians : GaussianSum
    maps : SkinMaps
    spec : DiffusionSpec
    like : sequence of Lobe
        As these were blurred, each by its method: some carry light through flesh.
    everywhere : EverywhereLight, optional
        Where lobes take light from everywhere otherwise than once; its light is not read.
    """

    def __init__(
        self,
        atlas: Atlas,
        mesh: SkinMesh,
        gaussians: GaussianSum,
        maps: SkinMaps,
        spec: DiffusionSpec,
        like: Sequence[Lobe],
        everywhere: EverywhereLight | None = None,
    ) -> None:
        self._weights = SkinWeights.of(gaussians, maps)
        self._share = self._weights.scattering_share(atlas)
        self._geometry = SkinGeometry(atlas, mesh)
        self._no_probes = draw_probes(self._geometry, 0, 0)
        self._spec = spec.model_copy(update={"tolerance": max(spec.tolerance, TOLERANCE)})
        self._everywhere = everywhere and everywhere._replace(rgb={})
        self._like = tuple(replace(lobe, rgb={}) for lobe in like)
        self._resources: LobeResources | None = None
        self._plans: list[LobePlan] = []

    def lobes(self, light: Tiles, otherwise: Sequence[bool] = ()) -> tuple[Lobe, ...]:
        """Every lobe of some lights from everywhere.

        Parameters
        ----------
        light : dict of int to ndarray of shape (L, h, w, 3), float32
            Of the atlas's size.
        otherwise : sequence of L bool, optional
            Which of them lobes take otherwise than once (`terms.diffuse_profile`).
        """
        if self._resources is None:
            self._resources = LobeResources(light, self._geometry, self._spec, self._share)
            self._plans = [self._plan(self._resources, lobe) for lobe in self._like]
        resources, lights = self._resources.with_light(light), len(next(iter(light.values())))
        everywhere = None
        if self._everywhere is not None and any(otherwise):
            counts = np.array(otherwise, np.float32)[:, None, None, None]
            everywhere = self._everywhere._replace(rgb={tile: rgb * counts for tile, rgb in light.items()})
        memoizer = Memoizer(resources, tuple(map(str, range(lights))), everywhere=everywhere)
        made = make_lobes(
            memoizer, self._plans, self._weights, self._no_probes, "float", lambda _: None, lambda _, tiles: tiles
        )
        return tuple(
            replace(lobe, method=plan.method.name, rgb=tiles)
            for lobe, plan, tiles in zip(self._like, self._plans, made.lobes, strict=True)
        )

    def of_even_light(self) -> tuple[Lobe, ...]:
        """Every lobe of a light of 1 from everywhere, which is taken otherwise than once."""
        return self.lobes({r.tile: np.ones((1, *r.shape, 3), np.float32) for r in self._geometry.atlas}, [True])

    def _plan(self, resources: LobeResources, lobe: Lobe) -> LobePlan:
        """A lobe's plan: by its own method, but sums of every texel are by clusters."""
        method: DiffusionMethod = METHODS[lobe.method or IDENTITY.name]
        if not method.blurs or lobe.variance_mm2 < LEAST_TEXELS2 * self._geometry.mean_texel_mm2:
            return LobePlan(IDENTITY, LobeParameters(lobe.variance_mm2), "nothing to blur")
        return plan_lobe(resources, METHODS["surface"] if method.exact else method, lobe.variance_mm2)
