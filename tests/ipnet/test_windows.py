"""Windows of a stream."""

import numpy as np

from ipnet.windows import Grid, WindowStream, means
from navcore.imu import ImuSamples


def ramp(n=1000, dt_ns=5_000_000, start_ns=0):
    """A signal that grows evenly: the mean over a cell is its value in the cell's middle."""
    t_ns = start_ns + np.arange(n) * dt_ns + dt_ns // 2
    t = t_ns * 1e-9
    return ImuSamples(t_ns, np.outer(t, [1.0, 2.0, 3.0]), np.outer(t, [4.0, 5.0, 6.0]))


def test_means_of_an_even_ramp_are_its_values_in_the_middle():
    edges = np.arange(0, 5_000_000_000, 20_000_000)
    middle = 0.5e-9 * (edges[1:] + edges[:-1])
    np.testing.assert_allclose(means(ramp(), edges), np.outer(middle, [1, 2, 3, 4, 5, 6]), atol=1e-9)


def test_chunks_do_not_matter():
    samples, grid = ramp(), Grid(2.0, 50.0, 0.5)
    whole = list(WindowStream(grid).add(samples))
    stream = WindowStream(grid)
    pieces = [w for k in range(0, 1000, 7) for w in stream.add(samples[k : k + 7])]
    assert [w.begin_ns for w in whole] == [0, 500_000_000, 1_000_000_000, 1_500_000_000, 2_000_000_000, 2_500_000_000]
    assert [w.begin_ns for w in pieces] == [w.begin_ns for w in whole]
    for a, b in zip(whole, pieces, strict=True):
        np.testing.assert_allclose(a.values, b.values, atol=1e-9)
        assert a.values.shape == (100, 6)


def test_windows_are_stamped_in_their_middle_and_come_when_they_are_over():
    samples = ramp()
    stream = WindowStream(Grid(2.0, 50.0, 0.5))
    assert list(stream.add(samples[:400])) == []  # the last sample's end is not known yet
    (window,) = stream.add(samples[400:402])
    assert window.middle_ns == 1_000_000_000


def test_no_window_spans_a_gap():
    early, late = ramp(500), ramp(700, start_ns=4_000_000_000)
    stream = WindowStream(Grid(2.0, 50.0, 0.5))
    begins = [w.begin_ns for part in (early, late) for w in stream.add(part)]
    assert begins == [0, 4_000_000_000, 4_500_000_000, 5_000_000_000]
    joined = ImuSamples(
        *(np.concatenate([a, b]) for a, b in zip(vars(early).values(), vars(late).values(), strict=True))
    )
    assert [w.begin_ns for w in WindowStream(Grid(2.0, 50.0, 0.5)).add(joined)] == begins
