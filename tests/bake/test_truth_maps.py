"""What maps of the skin say of places inside it, for walks."""

import numpy as np

from skinbake.baking.truth_maps import VaryingSkin
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.skin import PhysiologySkin
from skinbake.transport.light_leaving import light_leaving, medium_for_walks
from skinbake.transport.medium_of_skin import medium_of_skin
from tests.shapes import sphere
from tests.transport.solids import rays_of
from tests.transport.test_light_leaving import WHOLE, sky

SKIN = {"model": "physiology", "haemoglobin": 0.01, "epidermis_mm": 0.1}


def test_each_side_of_a_step_of_melanin_is_as_skin_of_that_melanin_everywhere():
    """A ball of 10 mm, its left half light and its right half dark: far from the border light leaves as it would."""
    ball = sphere(10.0, "cube", 24)
    rays = rays_of(ball)
    middle = ball.corner_position_mm.mean(axis=1)
    # Faces of the two halves read the two texels of the map
    u = np.where(middle[:, 0] > 0, 0.75, 0.25)
    uv = np.stack([u, np.full(len(u), 0.5)], axis=1)[:, None].repeat(3, axis=1)
    mesh = SkinMesh(ball.positions_mm, ball.faces, uv, ball.corner_normal)
    maps = SkinMaps(melanin={1001: np.array([[0.01, 0.2]], np.float32)})
    varying = VaryingSkin.of(mesh, maps, rays.rays.centre_mm, {"melanin": 0.05, "haemoglobin": 0.01})
    light, dark = (np.flatnonzero(side * middle[:, 0] > 9) for side in (-1, 1))
    assert varying.changes(middle[np.abs(middle[:, 0]) < 1]).all()
    assert not varying.changes(middle[np.concatenate([light, dark])]).any()

    grid, names = varying.grid()
    assert names == ("melanin", "haemoglobin")
    np.testing.assert_allclose([grid.least, grid.most], [[0.01, 0.01], [0.2, 0.01]], rtol=1e-6)
    medium = medium_for_walks(rays, medium_of_skin(PhysiologySkin(**SKIN, melanin=0.05), names), grid, names)
    for melanin, face in ((0.01, light), (0.2, dark)):
        face, place = face.astype(np.int32), np.full((len(face), 2), 0.3)
        alone = medium_for_walks(rays, medium_of_skin(PhysiologySkin(**SKIN, melanin=melanin)))
        got = light_leaving(rays, medium, [sky()], face, place, 96, 1)
        want = light_leaving(rays, alone, [sky()], face, place, 96, 2)
        difference = (got.mean[WHOLE] - want.mean[WHOLE]).mean(axis=0)
        noise = np.sqrt((got.stderr[WHOLE] ** 2 + want.stderr[WHOLE] ** 2).sum(axis=0)) / len(face)
        assert np.all(np.abs(difference) < 3.5 * noise), difference / noise
        assert np.all(noise < 0.09 * want.mean[WHOLE].mean(axis=0))
