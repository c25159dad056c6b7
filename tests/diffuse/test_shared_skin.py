"""Resources of several lights on one skin share what no light changes, and none reads another's light."""

import numpy as np

from skinbake.diffuse.resources import LobeResources, Resource
from skinbake.diffuse.surface_space.sources import LIGHT
from tests.diffuse.test_methods import lit


def alone(resources: LobeResources) -> LobeResources:
    """The same, of which nothing is shared."""
    return LobeResources(resources.source, resources.geometry, resources.spec)


def test_each_light_finds_its_own_on_the_places_of_all():
    """One tree in turn, to the bit what each makes alone; also of fewer lights, and after a release."""
    first = lit()
    second = first.with_light({tile: rgb[::-1] * np.float32(0.3) for tile, rgb in first.source.items()})
    fewer = first.of_lights([1])
    leaf, fewer_not_yet = first.texels().leaf, True
    for each in (second, first, first, second, fewer, second):
        got, want = each.texels(), alone(each).texels()
        np.testing.assert_array_equal(got.leaf, want.leaf)
        np.testing.assert_array_equal(got.box, want.box)
        assert got.leaf.shape[1] == LIGHT + 3 * each.lights
        if each is second and fewer_not_yet:
            assert got.leaf is leaf
        fewer_not_yet &= each is not fewer
    second.release({Resource.TEXELS})
    again = first.texels()
    assert again.leaf is not leaf
    np.testing.assert_array_equal(again.leaf, alone(first).texels().leaf)


def test_blocks_and_distances_are_made_once():
    """The second light has the first one's moments, and means of its own; none keeps the first one's light alive."""
    first = lit()
    second = first.with_light({tile: rgb * rgb for tile, rgb in first.source.items()})
    mine, other = second.lit[1001].pyramid, first.lit[1001].pyramid
    assert mine.moments is other.moments
    np.testing.assert_array_equal(mine.radiosity, alone(second).lit[1001].pyramid.radiosity)
    assert first._skin.foreign_mm(first.lit) is second._skin.foreign_mm(second.lit)
    np.testing.assert_array_equal(
        first._skin.foreign_mm(first.lit)[1001], (other := alone(first))._skin.foreign_mm(other.lit)[1001]
    )
    assert all(pyramid.radiosity.size == 0 for pyramid in first._skin._moments.values())
