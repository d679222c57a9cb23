"""Samples become cells: nothing of the integral is lost wherever a frame cuts, and gaps are owned up to."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from navcore.errors import InputError
from navcore.imu import ImuSamples
from navcore.imu_buffer import Cells, ImuBuffer

T0 = 1_700_000_000_000_000_000
STEP = 5_000_000  # ns, 200 Hz
EDGE = STEP // 2


def samples(stamps, rng=None, values=None):
    rng = rng or np.random.default_rng(0)
    values = rng.standard_normal((len(stamps), 6)) if values is None else values
    return ImuSamples(np.asarray(stamps, dtype=np.int64), values[:, :3], values[:, 3:])


def filled(n=40, values=None):
    data = samples(T0 + STEP * np.arange(n), values=values)
    buffer = ImuBuffer(200.0)
    buffer.append(data)
    return buffer, np.hstack([data.gyro, data.accel])


def integral(cells: Cells):
    return cells.dt @ np.hstack([cells.gyro, cells.accel])


def turn(cells: Cells):
    whole = Rotation.identity()
    for part in Rotation.from_rotvec(cells.gyro * cells.dt[:, None]):
        whole = whole * part
    return whole


def test_whole_cells_are_the_samples():
    buffer, values = filled()
    cells = buffer.cells(T0 + 10 * STEP - EDGE, T0 + 19 * STEP + EDGE)
    np.testing.assert_allclose(cells.dt, 0.005, rtol=1e-12)
    np.testing.assert_array_equal(np.hstack([cells.gyro, cells.accel]), values[10:20])
    assert not cells.bridged.any()


@given(cut=st.integers(1, 10 * STEP - 1))
def test_parts_of_a_cell_keep_its_mean_and_turn(cut):
    buffer, _ = filled()
    start, end = T0 + 10 * STEP - EDGE, T0 + 20 * STEP - EDGE
    before, after, whole = (
        buffer.cells(start, start + cut),
        buffer.cells(start + cut, end),
        buffer.cells(start, end),
    )
    parts = integral(before) + integral(after)
    np.testing.assert_allclose(parts[3:], integral(whole)[3:], atol=1e-15)
    assert (turn(before) * turn(after) * turn(whole).inv()).magnitude() < 1e-7  # a plain sum misses up to 2e-5
    np.testing.assert_allclose([before.dt.sum(), after.dt.sum()], [cut * 1e-9, (10 * STEP - cut) * 1e-9], atol=1e-15)


@given(start=st.integers(2 * STEP, 20 * STEP), length=st.integers(1, 15 * STEP))
def test_a_signal_that_grows_evenly_is_cut_exactly(start, length):
    slope = np.arange(1.0, 7.0)
    buffer, _ = filled(values=np.arange(40.0)[:, None] * 0.005 * slope)
    cells = buffer.cells(T0 + start, T0 + start + length)
    mean = (start + 0.5 * length) * 1e-9 * slope
    np.testing.assert_allclose(integral(cells), mean * length * 1e-9, rtol=1e-9)


def test_a_cut_exactly_on_a_stamp_makes_no_empty_cell():
    buffer, values = filled()
    cells = buffer.cells(T0 + 10 * STEP, T0 + 20 * STEP)
    np.testing.assert_allclose(cells.dt, [0.0025, *[0.005] * 9, 0.0025], rtol=1e-12)
    np.testing.assert_array_equal(np.hstack([cells.gyro, cells.accel])[1:-1], values[11:20])
    assert not cells.bridged.any()


def test_no_time_makes_no_cells():
    buffer, _ = filled()
    assert len(buffer.cells(T0 + STEP, T0 + STEP).dt) == 0
    assert len(buffer.cells(T0 + 2 * STEP, T0 + STEP).dt) == 0
    assert len(ImuBuffer(200.0).cells(T0, T0 + STEP).dt) == 0


def test_a_gap_is_bridged_by_its_two_ends_and_counted():
    """Half of the gap gets the last sample before it, half the first after; what no sample covers is told."""
    kept = [*range(20), *range(80, 100)]  # 0.3 s from stamp 19 to stamp 80
    data = samples(T0 + STEP * np.array(kept))
    buffer = ImuBuffer(200.0)
    buffer.append(data)
    cells = buffer.cells(T0 + 10 * STEP, T0 + 90 * STEP)
    assert cells.dt.sum() == pytest.approx(0.4, abs=1e-12)
    assert cells.bridged.sum() == pytest.approx(0.305 - 1.5 * 0.005, abs=1e-12)
    wide = np.argsort(cells.dt)[-2:]
    np.testing.assert_allclose(cells.dt[wide], 0.005 / 2 + 0.305 / 2, rtol=1e-9)
    np.testing.assert_array_equal(cells.gyro[np.sort(wide)], data.gyro[19:21])
    assert np.count_nonzero(cells.bridged) == 2


def test_stamps_that_jitter_are_no_gap():
    rng = np.random.default_rng(1)
    stamps = T0 + STEP * np.arange(40) + rng.integers(-STEP // 5, STEP // 5, 40)
    buffer = ImuBuffer(200.0)
    buffer.append(samples(stamps))
    assert not buffer.cells(T0 + 5 * STEP, T0 + 30 * STEP).bridged.any()


@pytest.mark.parametrize(("start", "end", "nearest"), [(-10, 0, 0), (39, 49, 39)])
def test_outside_the_samples_the_nearest_one_goes_on_and_is_counted(start, end, nearest):
    buffer, values = filled()
    cells = buffer.cells(T0 + start * STEP, T0 + end * STEP)
    assert cells.dt.sum() == pytest.approx(0.05, abs=1e-12)
    assert cells.bridged.sum() == pytest.approx(0.05 - 0.75 * 0.005, abs=1e-12)
    np.testing.assert_array_equal(cells.gyro, np.tile(values[nearest, :3], (len(cells.dt), 1)))


@given(drop=st.integers(0, 39 * STEP), length=st.integers(1, 10 * STEP))
def test_dropping_old_samples_changes_no_later_cell(drop, length):
    buffer, _ = filled()
    start = T0 + drop
    whole = buffer.cells(start, start + length)
    buffer.drop_before(start)
    after = buffer.cells(start, start + length)
    for name in ("dt", "gyro", "accel", "bridged"):
        np.testing.assert_array_equal(getattr(after, name), getattr(whole, name))
    assert buffer.oldest_ns >= start - 2 * STEP


@pytest.mark.parametrize("late", [0, STEP])
def test_samples_that_do_not_follow_are_refused_with_their_time(late):
    buffer, _ = filled()
    before = buffer.cells(T0, T0 + 39 * STEP)
    newest = T0 + 39 * STEP
    with pytest.raises(InputError, match=rf"{newest - late}.*{newest}"):
        buffer.append(samples([newest - late, newest + STEP]))
    assert buffer.newest_ns == newest
    np.testing.assert_array_equal(buffer.cells(T0, newest).gyro, before.gyro)


def test_samples_are_found_by_their_stamps():
    buffer, values = filled()
    t_ns, gyro, accel = buffer.samples(T0 + 3 * STEP, T0 + 6 * STEP)
    np.testing.assert_array_equal(t_ns, T0 + STEP * np.arange(3, 7))
    np.testing.assert_array_equal(np.hstack([gyro, accel]), values[3:7])
    assert buffer.oldest_ns == T0
    buffer.append(samples([]))
    assert buffer.newest_ns == T0 + 39 * STEP
