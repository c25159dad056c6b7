import numpy as np

from skinbake.irradiance.bump_terminator import BUMP_GAIN, bump_terminator


def test_a_bump_gets_at_most_a_multiple_of_what_the_skin_under_it_gets():
    """The light on it is its own cosine, or BUMP_GAIN times the smooth one's: continuous, growing with both."""
    smooth, mapped = np.meshgrid(np.linspace(-0.2, 1, 61), np.linspace(0.01, 1, 50))
    light = np.array([m * bump_terminator(m, s) for m, s in zip(mapped.flat, smooth.flat, strict=True)])
    np.testing.assert_allclose(light, np.clip(BUMP_GAIN * smooth.ravel(), 0, mapped.ravel()), rtol=1e-15)
    light = light.reshape(mapped.shape)
    assert (np.diff(light, axis=0) >= -1e-15).all()
    assert (np.diff(light, axis=1) >= -1e-15).all()


def test_lit_skin_keeps_its_energy():
    """A surface of bumps of up to 20 degrees, lit from 60 degrees up or higher, gets all of its cosines."""
    tilts = np.radians(np.linspace(-20, 20, 41))
    for elevation in np.radians([60, 75, 90]):
        assert all(bump_terminator(np.sin(elevation + t), np.sin(elevation)) == 1 for t in tilts)
