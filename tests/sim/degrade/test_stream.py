"""Frames that do not come, stamps that are wrong."""

import numpy as np
import pytest

from navcore.sequence import Frame
from sim.degrade import Schedule, restream
from sim.degrade.schedule import STREAM
from sim.degrade.stream import FRAME_DROPS, LOW_RATE, TIME_JITTER_S, TIME_OFFSET_S

START_NS = 1_403_636_579_758_555_392


def frames(n: int, step_ns: int = 50_000_000) -> list[Frame]:
    return [Frame(START_NS + k * step_ns) for k in range(n)]


def stamps(spec: str, n: int = 400, seed: int = 1) -> np.ndarray:
    return np.array([f.t_ns for f in restream(frames(n), Schedule.parse(spec), seed)])


@pytest.mark.parametrize("kind", STREAM)
@pytest.mark.parametrize("severity", [1, 3, 5])
def test_stamps_increase_and_frames_outside_stay(kind: str, severity: int) -> None:
    for step_ns in (50_000_000, 10_000_000):  # 20 and 100 Hz: an offset may be longer than the way to the next frame
        before = frames(400, step_ns)
        end_s = 400 * step_ns * 1e-9
        spec = f"{kind}:{severity}@{0.25 * end_s}-{0.5 * end_s}"
        after = restream(before, Schedule.parse(spec), 1)
        assert np.all(np.diff([f.t_ns for f in after]) > 0)
        assert list(after[:100]) == before[:100]
        assert list(after[-200:]) == before[-200:]
        assert list(after) != before


def test_drops_have_their_share_and_their_bursts() -> None:
    for severity, drops in enumerate(FRAME_DROPS, start=1):
        n = 12_000
        left = (stamps(f"frame_drops:{severity}@0-{n}", n) - START_NS) // 50_000_000
        lost = np.ones(n, dtype=bool)
        lost[left] = False
        edges = np.flatnonzero(np.diff(lost.astype(int)))
        bursts = (lost.sum()) / (len(edges) / 2.0)
        assert lost.mean() == pytest.approx(drops.share, rel=0.12)
        assert bursts == pytest.approx(drops.burst, rel=0.12)


def test_a_low_rate_keeps_one_of_n() -> None:
    for severity, n in enumerate(LOW_RATE, start=1):
        gaps = np.diff(stamps(f"low_rate:{severity}@5-15"))
        assert np.bincount(gaps // 50_000_000).argmax() in (1, n)
        assert gaps.max() == n * 50_000_000


def test_jitter_has_its_size_and_no_mean() -> None:
    true = np.array([f.t_ns for f in frames(4000)])
    for severity in (1, 2, 3):
        error = (stamps(f"time_jitter:{severity}@0-200", 4000) - true) * 1e-9
        assert error.std() == pytest.approx(TIME_JITTER_S[severity - 1], rel=0.05)
        assert abs(error.mean()) < 4.0 * TIME_JITTER_S[severity - 1] / np.sqrt(4000)


def test_an_offset_is_late_by_what_it_says() -> None:
    true = np.array([f.t_ns for f in frames(400)])
    for severity, offset_s in enumerate(TIME_OFFSET_S, start=1):
        error = stamps(f"time_offset:{severity}@5-10") - true
        assert set(error[100:200].tolist()) == {round(offset_s * 1e9)}
        assert not error[:100].any() and not error[200:].any()


def test_a_draw_depends_on_the_frame_alone() -> None:
    whole, part = stamps("time_jitter:3@0-20"), stamps("time_jitter:3@5-10,low_rate:2@15-16")
    np.testing.assert_array_equal(part[100:200], whole[100:200])
    assert not np.array_equal(stamps("time_jitter:3@0-20", seed=2), whole)
    assert restream([], Schedule.parse("low_rate:1@0-1")) == ()
