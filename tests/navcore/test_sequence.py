from dataclasses import replace

import numpy as np
import pytest

from navcore.errors import DataError
from navcore.imu import ImuSamples
from navcore.sequence import Frame, Tracks
from tests.navcore.recordings import FRAME_STEP_NS, sequence


def test_events_come_in_the_order_in_which_a_live_system_sees_them():
    whole = sequence()
    offset_ns = round(whole.calibration.cameras[0].dt_cam_imu * 1e9)
    seen, frames = [], []
    for event in whole.events():
        if isinstance(event, Frame):
            frames.append(event.t_ns)
            assert seen[-1] == event.t_ns + offset_ns  # no sample up to the frame comes after it
        else:
            seen += event.t_ns.tolist()
    assert seen == whole.imu.t_ns.tolist()
    assert frames == [f.t_ns for f in whole.frames]


def test_without_frames_there_is_one_chunk():
    (event,) = sequence(frames=0).events()
    assert isinstance(event, ImuSamples)
    assert len(event) == 201


def test_span_counts_from_the_first_frame_and_keeps_imu_before_it():
    whole = sequence()
    part = whole.span(0.1, 0.3)
    first = whole.frames[0].t_ns
    assert [f.t_ns for f in part.frames] == [first + k * FRAME_STEP_NS for k in range(2, 7)]
    assert part.imu.t_ns[0] == first  # 0.1 s before the first frame that is left
    assert part.imu.t_ns[-1] == whole.imu.t_ns[-1]
    assert whole.span().frames == list(whole.frames)


@pytest.mark.parametrize("span", [(5.0, None), (None, -1.0), (0.3, 0.1)])
def test_an_empty_span_says_where_frames_end(span):
    with pytest.raises(DataError, match=r"still: no frame between .*; frames end at 0\.45 s"):
        sequence().span(*span)


def test_nothing_to_cut_by():
    with pytest.raises(DataError, match="has no frames to cut by"):
        replace(sequence(), frames=()).span(1.0)


def test_tracks_check_their_shapes():
    assert len(Tracks(np.array([3, 4]), np.zeros((2, 2)))) == 2
    with pytest.raises(DataError, match=r"uv has shape \(3, 2\), expected \(2, 2\)"):
        Tracks(np.array([3, 4]), np.zeros((3, 2)))
