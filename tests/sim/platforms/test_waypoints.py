import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.platforms.waypoints import Box, Path, random_path

BOX = Box((-3.8, -2.8, 1.1), (3.8, 2.8, 3.0))


def path_of(seed: int, seconds: float) -> Path:
    return random_path(BOX, np.array([1.0, -2.0, 0.12]), seconds, 1.5, 0.35, np.random.default_rng(seed), 2.0)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([10.0, 60.0, 600.0]))
def test_it_stays_in_its_box_once_it_is_there(seed: int, seconds: float) -> None:
    p = path_of(seed, seconds).sample(np.arange(2.0, seconds + 2.0, 0.02)).p
    inside = np.all((p >= np.array(BOX.low) - 1e-9) & (p <= np.array(BOX.high) + 1e-9), axis=1)
    entered = int(np.argmax(inside))
    assert entered < 250  # 5 s
    assert inside[entered:].all()
    assert p[:, 2].min() > 0.119


def test_derivatives_are_those_of_the_path_and_it_starts_at_rest() -> None:
    path, h = path_of(3, 20.0), 1e-4
    t = np.arange(2.5, 20.0, 0.37)
    here, before, after = (path.sample(t + d) for d in (0.0, -h, h))
    np.testing.assert_allclose((after.p - before.p) / (2 * h), here.v, atol=1e-5)
    np.testing.assert_allclose((after.v - before.v) / (2 * h), here.a, atol=1e-5)
    rest = path.sample(np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(rest.p, np.tile([1.0, -2.0, 0.12], (3, 1)), atol=1e-12)
    np.testing.assert_allclose(np.hstack([rest.v, rest.a]), 0.0, atol=1e-9)


def test_mean_speed_is_what_is_asked() -> None:
    for seed in range(6):
        v = path_of(seed, 60.0).sample(np.arange(6.0, 62.0, 0.05)).v
        speed = np.linalg.norm(v, axis=1)
        assert abs(speed.mean() - 1.5) < 0.2
        assert speed.max() < 4.0
