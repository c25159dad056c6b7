"""The tree of sources holds every texel once, and finds all that is near."""

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.diffuse.surface_space.points import texel_points
from skinbake.diffuse.surface_space.put_light import put_light
from skinbake.diffuse.surface_space.source_search import (
    GROUPS,
    LEAVES,
    STACK,
    Search,
    near_boxes,
    near_sources,
    opposite_sources,
    sources_around,
    tree_node,
)
from skinbake.diffuse.surface_space.sources import (
    AMPLITUDE,
    LIGHT,
    NARROWING,
    NORMAL,
    source_tree,
)
from skinbake.diffuse.surface_space.surface_light import surface_light
from skinbake.kernels.simd import LANES
from tests.shapes import sphere


@pytest.fixture(scope="module")
def light():
    """Two UDIM tiles of odd sizes, charts with gaps between them, two lights."""
    mesh = sphere(30, "latlong", 40, 2)
    atlas = rasterize(mesh, (150, 117), udim=True)
    rng = np.random.default_rng(0)
    source = {raster.tile: rng.random((2, 117, 150, 3)).astype(np.float32) for raster in atlas}
    return surface_light(source, {raster.tile: texel_points(raster, mesh, np.zeros(3)) for raster in atlas})


def sources(tree):
    """All of a tree, (S, 8 + C)."""
    return tree.leaf.transpose(0, 2, 1)[tree.leaf[:, AMPLITUDE] > 0]


def test_every_texel_that_has_area_is_a_source_once(light):
    """With its own place, area and light, whatever the order."""
    tree = source_tree(light)
    found = sources(tree)
    assert len(found) == tree.count
    want = []
    for points, rgb, _ in light.values():
        skin = points.area_mm2 > 0
        colours = rgb[:, points.flat_index[skin]].transpose(1, 0, 2).reshape(-1, 6)
        narrowing = np.ones((len(colours), 1), np.float32)
        area = points.area_mm2[skin, None]
        want.append(np.hstack([points.position[skin], points.normal[skin], narrowing, area, colours]))
    want = np.concatenate(want)
    np.testing.assert_array_equal(found[np.lexsort(found.T)], want[np.lexsort(want.T)])


@pytest.mark.parametrize(("spread", "fewer"), [(0.2, 0.5), (1.0, 0.15)])
def test_clusters_keep_area_centroid_and_light(light, spread, fewer):
    """Fewer sources, the same moments."""
    texels, tree = source_tree(light), source_tree(light, spread, 4.0)
    assert tree.count < fewer * texels.count
    moments = []
    for each in (sources(texels), sources(tree)):
        area = (each[:, AMPLITUDE] / each[:, NARROWING]).astype(np.float64)
        about = np.column_stack([np.ones(len(area)), each[:, :3], each[:, LIGHT:]])
        moments.append(area @ about)
    np.testing.assert_allclose(moments[0], moments[1], rtol=2e-5, atol=2e-5 * moments[0][0] * 30)
    assert sources(tree)[:, NARROWING].min() >= 1
    assert sources(tree)[:, NARROWING].max() <= 4 / (4 - spread) + 1e-6


@pytest.mark.parametrize("spread", [-1.0, 0.2])
def test_other_light_takes_its_place_to_the_bit(light, spread):
    """Texels and clusters; all else stays."""
    points = {tile: lit.points for tile, lit in light.items()}
    source = {tile: lit.radiosity.reshape(2, 117, 150, 3)[::-1] ** 2 for tile, lit in light.items()}
    other = surface_light(source, points)
    tree, want = source_tree(light, spread, 4.0), source_tree(other, spread, 4.0)
    assert (tree.leaf != want.leaf).any()
    put_light(tree, other)
    np.testing.assert_array_equal(tree.leaf, want.leaf)


def test_moments_of_other_light_are_taken(light):
    """To the bit those that are made anew, and not made again."""
    points = {tile: lit.points for tile, lit in light.items()}
    source = {tile: lit.radiosity.reshape(2, 117, 150, 3) ** 2 for tile, lit in light.items()}
    taken = surface_light(source, points, same={tile: lit.pyramid for tile, lit in light.items()})
    for tile, made in surface_light(source, points).items():
        assert taken[tile].pyramid.moments is light[tile].pyramid.moments
        for one, other in zip(taken[tile].pyramid, made.pyramid, strict=True):
            np.testing.assert_array_equal(one, other)


def test_boxes_enclose_what_is_below_them(light):
    """Leaves their sources, groups their boxes, up to one group; no leaf is empty, none has a gap in it."""
    tree = source_tree(light)
    there = tree.leaf[:, AMPLITUDE] > 0
    assert there[:, 0].all()
    assert (there[:, :-1] >= there[:, 1:]).all()
    assert (tree.leaf.transpose(0, 2, 1)[~there][:, :3] > 1e15).all()
    inside = np.where(there[:, None], tree.leaf[:, :3], np.nan)
    low, high = np.nanmin(inside, axis=2), np.nanmax(inside, axis=2)
    for level, start in enumerate(tree.first_group):
        stop = tree.first_group[level + 1] if level + 1 < len(tree.first_group) else len(tree.box)
        boxes = tree.box[start:stop].transpose(0, 2, 1).reshape(-1, 6)
        np.testing.assert_array_equal(boxes[: len(low), :3], low)
        np.testing.assert_array_equal(boxes[: len(low), 3:], high)
        low, high = tree.box[start:stop, :3].min(axis=2), tree.box[start:stop, 3:].max(axis=2)
    assert stop - start == 1


@pytest.mark.parametrize("size", [0.0, 3.0])
def test_the_search_finds_exactly_what_is_near(light, size):
    """Against all distances, from the root and from a level on the way."""
    tree = source_tree(light)
    there = tree.leaf[:, AMPLITUDE] > 0
    position, normal = sources(tree)[:, :3], sources(tree)[:, NORMAL : NORMAL + 3]
    leaf = np.nonzero(there)[0]
    room = Search(np.empty(STACK, np.int64), np.empty(len(tree.leaf), np.int64))
    stack, found = room
    flat = tree.leaf.reshape(-1)
    for at, axis in zip(position[::997], normal[::997], strict=True):
        low, high = at - np.float32(size / 2), at + np.float32(size / 2)
        radius2 = np.float32(25)
        gap = np.maximum(np.maximum(position - high, low - position), 0)
        stack[0] = tree_node(0, len(tree.first_group) - 1)
        leaves = found[: near_boxes(low, high, radius2, tree.arrays, room, 1, LEAVES)].copy()
        stack[0] = tree_node(0, len(tree.first_group) - 1)
        groups = near_boxes(low, high, radius2, tree.arrays, room, 1, GROUPS)
        stack[:groups] = [tree_node(group, 0) for group in found[:groups]]
        again = found[: near_boxes(low, high, radius2, tree.arrays, room, groups, LEAVES)]
        np.testing.assert_array_equal(np.sort(leaves), np.sort(again))
        tests = {
            "box": (near_sources, (low, high, radius2), (gap**2).sum(axis=1) < radius2),
            "ball": (sources_around, (*at, radius2), ((position - at) ** 2).sum(axis=1) < radius2),
            "cone": (opposite_sources, (*axis, np.float32(0.2)), normal @ axis < 0.2),
        }
        for search, arguments, want in tests.values():
            near = leaves if search is not opposite_sources else np.arange(len(tree.leaf))
            found_in = np.zeros(there.shape, bool)
            for k in near:
                found_in[k] = search(flat, k * tree.leaf[0].size, *arguments) >> np.arange(LANES) & 1
            got = found_in[there]
            assert np.count_nonzero(got != want) <= 1 + len(position) // 5000  # a distance that rounds across
            assert set(leaf[want & got]) <= set(near)
