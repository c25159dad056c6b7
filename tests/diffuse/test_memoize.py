"""What is remembered of a light is asked for before it is made, and changes no bit."""

import numpy as np
import pytest

from skinbake.diffuse.draw_probes import draw_probes
from skinbake.diffuse.memoize import Memoizer
from skinbake.diffuse.methods import METHODS, LobeParameters
from tests.diffuse.test_methods import lit

LOBE = LobeParameters(2.0, 0, 0.8, 0.02)
OPERATIONS = ("map", "at_probes", "read_stored")


class Store:
    """Remembers in a dictionary, and lists what had to be made."""

    def __init__(self):
        self.entries, self.made = {}, []

    def __call__(self, kind, names, make):
        missing = tuple(name for name in names if (kind, name) not in self.entries)
        if missing:
            self.made.append((kind[:2], missing))
            self.entries |= {(kind, name): values for name, values in make(missing).items()}
        return {name: self.entries[kind, name] for name in names}


def run(memoizer, method, operation, probes, lobe=LOBE):
    """All of an operation's values, flat."""
    if operation == "map":
        return np.concatenate([rgb.ravel() for rgb in memoizer.map(method, lobe).values()])
    return getattr(memoizer, operation)(method, lobe, probes).ravel()


@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("name", METHODS)
def test_bits_are_those_of_a_bake_from_nothing(name, operation):
    """With nothing known, with all of it known, and with one light of two that has changed."""
    method, before, now = METHODS[name], lit(), lit()
    now.source[1001][1] *= np.float32(0.37)
    probes = draw_probes(now.geometry, 50, 0)
    want = run(Memoizer(now, ("key", "rim")), method, operation, probes)
    store = Store()
    run(Memoizer(before, ("key", "rim before"), store), method, operation, probes)
    store.made.clear()
    for made in ([("rim",)], []):
        got = run(Memoizer(now, ("key", "rim"), store), method, operation, probes)
        np.testing.assert_array_equal(got, want)
        assert [names for _, names in store.made] == ([] if method.quick else made)
        store.made.clear()


def test_other_probes_and_other_parameters_are_not_taken_for_the_same():
    """Nor is another method."""
    resources, store = lit(), Store()
    memoizer = Memoizer(resources, ("key", "rim"), store)
    probes, others = (draw_probes(resources.geometry, 50, seed) for seed in (0, 1))
    for asked in (
        (METHODS["surface"], LOBE, probes),
        (METHODS["surface"], LOBE, others),
        (METHODS["surface"], LOBE._replace(spacing=0.5), probes),
        (METHODS["hybrid"], LOBE, probes),
    ):
        memoizer.at_probes(*asked)
    assert len(store.made) == 4


@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("name", METHODS)
def test_wide_lobes_blur_the_light_that_was_shifted_and_narrow_ones_do_not(name, operation):
    """To the bit what each light gives by itself, remembered or not."""
    method, near, far = METHODS[name], lit(), lit()
    for rgb in far.source.values():
        rgb *= np.float32(0.7)
    probes = draw_probes(near.geometry, 50, 0)
    both = [Memoizer(near, ("key", "rim"), store, far, 0.16) for store in (None, Store())]
    for lobe, of in ((LobeParameters(0.15, 0, 0.8, 0.02), near), (LobeParameters(0.17, 0, 0.8, 0.02), far)):
        want = run(Memoizer(of, ("key", "rim")), method, operation, probes, lobe)
        for memoizer in both:
            np.testing.assert_array_equal(run(memoizer, method, operation, probes, lobe), want)
            assert memoizer.of_lobe(lobe.variance_mm2) is of
