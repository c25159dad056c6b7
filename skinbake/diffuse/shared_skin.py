"""What resources of different lights on one skin have in common: what no light changes."""

from __future__ import annotations

from weakref import ReferenceType, ref

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiled, Tiles
from skinbake.diffuse.aside import Aside
from skinbake.diffuse.surface_space.clusters import MomentPyramid
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.diffuse.surface_space.put_light import put_light
from skinbake.diffuse.surface_space.sources import LIGHT, SourceTree, source_tree
from skinbake.diffuse.surface_space.surface_light import LitTile, surface_light
from skinbake.diffuse.texture_space.uv_gaps import distance_to_foreign


class SharedSkin:
    """Moments of blocks of texels, how far off other skin is, and the tree of all texels, for one light after another.

    Each is made for the first that asks.

    Parameters
    ----------
    aside : Aside
        Where they stand while they are not read.
    """

    def __init__(self, aside: Aside) -> None:
        self._aside = aside
        self._moments: Tiled[MomentPyramid] | None = None
        self._foreign_mm: Tiled[NDArray[np.float32]] | None = None
        self._texels: SourceTree | None = None
        self._of: ReferenceType[object] | None = None  # whose light is in them

    def lit(self, source: Tiles, points: Tiled[TexelPoints]) -> Tiled[LitTile]:
        """Skin points, light and moments of each tile; the points are the same each time.

        Parameters
        ----------
        source : Tiles
            Light.
        points : Tiled of TexelPoints
        """
        found = surface_light(source, points, self._aside.zeros, self._moments)
        if self._moments is None:
            # Without the light: it may be only one lobe's
            none = np.empty((0, 0), np.float32)
            self._moments = {tile: each.pyramid._replace(radiosity=none) for tile, each in found.items()}
        self._aside.rest()
        return found

    def foreign_mm(self, lit: Tiled[LitTile]) -> Tiled[NDArray[np.float32]]:
        """`distance_to_foreign` of blocks."""
        if self._foreign_mm is None:
            self._foreign_mm = distance_to_foreign({tile: each.pyramid for tile, each in lit.items()})
        return self._foreign_mm

    def texels(self, owner: object, lit: Tiled[LitTile]) -> SourceTree:
        """Every texel as a source, with some light: until other light is asked for, which takes its place.

        Parameters
        ----------
        owner : object
            Tells the light from others.
        lit : Tiled of LitTile
            Light of the owner.
        """
        tree, width = self._texels, LIGHT + 3 * len(next(iter(lit.values())).radiosity)
        if tree is None or tree.leaf.shape[1] != width:
            self._texels = None
            tree = self._texels = source_tree(lit, zeros=self._aside.zeros, rest=self._aside.rest)
            self._aside.rest()  # what it was made of
        elif self._of is None or self._of() is not owner:
            put_light(tree, lit)  # the tree is read at once: without a rest, which would let go of it
        self._of = ref(owner)
        return tree

    def release_texels(self) -> None:
        """Free the memory of the tree; it is made again if it is asked for after all."""
        self._texels = self._of = None
