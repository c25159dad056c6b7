"""A large result is made when it is wanted, once, until it is let go."""

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
