"""The independent test vectors, where they are at hand, and the published media."""

import json
from pathlib import Path

import numpy as np
import pytest

from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.models import DipoleProfile, LayeredProfile

VECTORS = Path(__file__).parents[3] / "shared" / "test_vectors.json"


@pytest.fixture(scope="session")
def vectors():
    if not VECTORS.is_file():
        pytest.skip(f"{VECTORS} is not beside this checkout")
    return {vector["id"]: vector for vector in json.loads(VECTORS.read_text())["vectors"]}


@pytest.fixture
def agrees(vectors):
    """Compare with a vector by its own tolerance: |x - expected| <= atol + rtol |expected|."""

    def check(name, value):
        vector = vectors[name]
        np.testing.assert_allclose(value, vector["expected"], rtol=vector["rtol"], atol=vector["atol"], err_msg=name)

    return check


def medium(sigma_a, sigma_sp):
    return Medium(np.atleast_1d(np.asarray(sigma_a, float)), np.atleast_1d(np.asarray(sigma_sp, float)))


@pytest.fixture(scope="session")
def three_layers():
    """Donner & Jensen 2005, 1/mm."""
    rows = [
        ([0.21, 0.21, 0.50], [4.8, 6.0, 6.5], 0.25),
        ([0.016, 0.019, 0.030], [3.2, 4.0, 4.6], 0.20),
        ([0.0085, 0.10, 2.5], [0.45, 0.47, 0.48], np.inf),
    ]
    return tuple(Layer(medium(a, s), d, 1.4) for a, s, d in rows)


@pytest.fixture(scope="session")
def three_layer_skin(three_layers):
    return LayeredProfile(three_layers)


@pytest.fixture(scope="session")
def skin1():
    """Jensen et al. 2001."""
    return DipoleProfile(medium([0.032, 0.17, 0.48], [0.74, 0.88, 1.01]), 1.3)
