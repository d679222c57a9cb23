from dataclasses import replace

import numpy as np
import pytest

from navcore import so3
from navcore.errors import DataError
from sim.motion import Motion
from sim.replay import SmoothedTruth, smooth_truth
from tests.sim.replay.flights import P_BT, R_BT, R_VW, SHIFT_OFFSET_S, TURN_OFFSET_S, Spoilt, spoil


@pytest.fixture(scope="module")
def spoilt(flight: Motion) -> Spoilt:
    return spoil(flight, gap_s=(8.0, 10.0), outliers=60)


@pytest.fixture(scope="module")
def smoothed(spoilt: Spoilt) -> SmoothedTruth:
    return smooth_truth(spoilt.recording)


def test_the_constants_come_back_as_well_as_they_claim(smoothed: SmoothedTruth) -> None:
    found = smoothed.smoothed.mounting
    offsets = [found.turn_offset_s - TURN_OFFSET_S, found.shift_offset_s - SHIFT_OFFSET_S]
    angles = so3.log(np.stack([R_VW.T @ found.R_VW, R_BT.T @ found.R_BT]))
    error = np.concatenate([offsets, angles[0, :2], angles[1], found.p_BT - P_BT])
    assert np.abs(error[:2]).max() < 1e-3
    assert np.abs(error[2:7]).max() < 2e-3
    assert np.abs(error / smoothed.smoothed.mounting_sd).max() < 4.0


def test_the_path_is_nearer_to_what_happened_than_truth_was(spoilt: Spoilt, smoothed: SmoothedTruth) -> None:
    truth = smoothed.truth
    ideal = spoilt.motion.at(truth.t_ns)
    turn = so3.log(np.swapaxes(truth.R_WB, 1, 2) @ ideal.R_WB)
    assert np.sqrt(np.mean(turn**2)) < 1e-3
    shift = truth.p_WB - ideal.p_WB
    assert np.linalg.norm(shift.mean(axis=0)) < 5e-3  # a short flight says little of the lever arm
    assert shift.std(axis=0).max() < 1.2e-3
    assert truth.v_WB is not None and ideal.v_WB is not None
    assert np.sqrt(np.mean((truth.v_WB - ideal.v_WB) ** 2)) < 5e-3


def test_a_truth_that_leans_now_this_way_now_that_is_not_followed(flight: Motion) -> None:
    """Gyro and accelerometer say so together; and nothing leans so in the path where truth does not."""
    errors = []
    for lean_rad in (0.0, 3e-3):
        spoilt = spoil(flight, lean_rad=lean_rad)
        truth = smooth_truth(spoilt.recording).truth
        turn = so3.log(np.swapaxes(truth.R_WB, 1, 2) @ spoilt.motion.at(truth.t_ns).R_WB)
        errors.append(turn.std(axis=0).max())
    assert errors[0] < 5e-4
    assert errors[1] < 6e-4


def test_biases_come_back(spoilt: Spoilt, smoothed: SmoothedTruth) -> None:
    ideal = spoilt.ideal.at(smoothed.truth.t_ns)
    assert smoothed.truth.b_g is not None and smoothed.truth.b_a is not None
    assert ideal.b_g is not None and ideal.b_a is not None
    assert np.abs(smoothed.truth.b_g - ideal.b_g).max() < 1e-3
    assert np.abs(smoothed.truth.b_a - ideal.b_a).max() < 0.05


def test_a_short_gap_is_bridged(spoilt: Spoilt, smoothed: SmoothedTruth) -> None:
    (low, high), *more = smoothed.bridged_ns.tolist()
    assert not more
    assert len(smoothed.left_out_ns) == 0
    t_ns = np.arange(low, high, 5_000_000)
    assert smoothed.known(t_ns).all()
    error = smoothed.motion.at(t_ns).p_WB - spoilt.motion.at(t_ns).p_WB
    assert np.abs(error).max() < 0.01
    assert "bridged" in "\n".join(smoothed.notes)


def test_a_long_gap_is_left_out(flight: Motion) -> None:
    path = smooth_truth(spoil(flight, gap_s=(3.0, 17.0)).recording)
    assert len(path.left_out_ns) == 1
    low, high = ((path.left_out_ns[0] - flight.start_ns) * 1e-9).tolist()
    assert 3.0 < low < 10.0 < high < 17.0
    assert len(path.bridged_ns) == 0
    assert not path.known(path.left_out_ns.ravel()).any()
    assert not np.any((path.truth.t_ns >= path.left_out_ns[0, 0]) & (path.truth.t_ns <= path.left_out_ns[0, 1]))
    assert path.truth.seconds[-1] > 19.0
    assert "left out" in "\n".join(path.notes)


def test_the_same_recording_gives_the_same_path(spoilt: Spoilt, smoothed: SmoothedTruth) -> None:
    again = smooth_truth(spoilt.recording)
    assert again.motion.p_WB.tobytes() == smoothed.motion.p_WB.tobytes()


def test_without_truth_or_imu_there_is_nothing_to_smooth(spoilt: Spoilt) -> None:
    recording = spoilt.recording
    assert recording.truth is not None
    with pytest.raises(DataError, match="has no truth"):
        smooth_truth(replace(recording, truth=None))
    with pytest.raises(DataError, match="no time in common"):
        smooth_truth(replace(recording, imu=recording.imu[:100], truth=recording.truth[-100:]))
    imu = recording.imu
    hole = type(imu)(*(np.delete(x, slice(1000, 1100), axis=0) for x in (imu.t_ns, imu.gyro, imu.accel)))
    with pytest.raises(DataError, match="samples are missing"):
        smooth_truth(replace(recording, imu=hole))
