"""Lobes for the tests: what a bake sets up around one method."""

from __future__ import annotations

from skinbake.diffuse.draw_probes import draw_probes
from skinbake.diffuse.methods import METHODS, LobeParameters
from skinbake.diffuse.resources import LobeResources
from skinbake.diffuse.skin_geometry import SkinGeometry
from skinbake.scene.spec import DiffusionSpec


def resources_of(light, atlas, mesh, **spec):
    """Resources of light that is given as an (L, H, W, 3) for each tile of the atlas, in order."""
    source = {raster.tile: rgb for raster, rgb in zip(atlas, light, strict=True)}
    return LobeResources(source, SkinGeometry(atlas, mesh), DiffusionSpec().model_copy(update=spec))


def lobe_map(resources, method, *parameters):
    """The first tile of a lobe, (L, h, w, 3); parameters as in `LobeParameters`."""
    return next(iter(METHODS[method].map(resources, LobeParameters(*parameters)).values()))


def probes_of(resources, count):
    """Probes of seed 0."""
    return draw_probes(resources.geometry, count, 0)


def exact_at(resources, variance_mm2, probes):
    """The surface integral at probes, (P, 3 L)."""
    return METHODS["reference"].at_probes(resources, LobeParameters(variance_mm2), probes)
