"""A large result is made when it is wanted, once, until it is let go."""

import weakref

from skinbake.diffuse.on_demand import OnDemand


def test_it_is_made_once_until_it_is_released():
    """Also when it is None."""
    made = []
    for result in (7, None):
        made.clear()
        held = OnDemand(lambda result=result: (made.append(1), result)[1])
        assert made == []
        assert held.get() is held.get() is result
        assert len(made) == 1
        held.release()
        held.release()
        assert held.get() is result
        assert len(made) == 2


def test_what_a_method_makes_goes_with_its_object():
    """At once, and not when the collector comes round."""

    class Maker:
        def __init__(self):
            self.held = OnDemand(self.make)

        def make(self):
            return {1, 2}

    maker = Maker()
    result = weakref.ref(maker.held.get())
    assert result() == {1, 2}
    del maker
    assert result() is None
