"""Scores of sources, on spans made here and sources whose scores are known."""

from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points

import numpy as np
import pytest

from ipnet import runs
from ipnet.axes import axes_of
from ipnet.device import Device
from ipnet.errors import ConfigError
from ipnet.offsets import offsets_of, slope
from ipnet.recordings import Label, Recording
from ipnet.runs import cut, run
from ipnet.score_tables import tables
from ipnet.scoring import ScoreConfig, score
from navcore import prior
from navcore.imu import GRAVITY, ImuNoise, ImuSamples
from navcore.prior import BiasPrior

NOISE = ImuNoise(1e-4, 0.0, 1e-3, 0.0)
UP = np.array([GRAVITY, 0.0, 0.0])
SIGMA_C, SIGMA_E = np.repeat([0.01, 0.05], 3), np.repeat([0.02, 0.1], 3)


def recording(name="r0", seconds=60.0, bias=None, rate=20.0):
    """A body that stands still, x up."""
    b = np.zeros(6) if bias is None else bias
    t_ns = np.rint(np.arange(round(seconds * rate)) / rate * 1e9).astype(np.int64) + 1_000_000_000
    gyro, accel = np.tile(b[:3], (len(t_ns), 1)), np.tile(b[3:] + UP, (len(t_ns), 1))
    return Recording(name, ImuSamples(t_ns, gyro, accel), NOISE, None, Label(name, b, 1e-12 * np.eye(6)))


def recordings(n, spread=(0.05, 0.3), seed=0, seconds=60.0):
    rng = np.random.default_rng(seed)
    return [recording(f"r{k}", seconds, bias=rng.normal(size=6) * np.repeat(spread, 3)) for k in range(n)]


class Source:
    """A source with a known error: z = gain b + c + e every 5 s; what it states is off by a factor."""

    window_s = 5.0

    def __init__(self, sequence, gain, stated):
        self.constant_covariance = np.diag((stated * SIGMA_C) ** 2)
        self._rng = np.random.default_rng(int(sequence.name[1:]))
        self._gain, self._stated = gain, stated
        self._c = self._rng.normal(size=6) * SIGMA_C
        self._begin_ns, self._done, self._b = None, 0, None

    def device(self):
        return None

    def add_imu(self, samples):
        if self._begin_ns is None:
            self._begin_ns = int(samples.t_ns[0])
        self._b = np.concatenate([samples.gyro[0], samples.accel[0] - UP])

    def poll(self, t_ns):
        given = []
        while self._begin_ns + (self._done + 1) * 5_000_000_000 <= t_ns:
            z = self._gain * self._b + self._c + self._rng.normal(size=6) * SIGMA_E
            t = self._begin_ns + round((self._done + 0.5) * 5e9)
            given.append(BiasPrior(t, z[:3], z[3:], np.diag((self._stated * SIGMA_E) ** 2)))
            self._done += 1
        return given


def make(argument, sequence):
    return Source(sequence, *(float(x) for x in argument.split(",")))


@pytest.fixture
def known_sources(monkeypatch):
    """`known:GAIN,STATED`."""
    entries = [*entry_points(group=prior.GROUP), EntryPoint("known", f"{__name__}:make", prior.GROUP)]
    monkeypatch.setattr(prior, "_known", lambda: {entry.name: entry for entry in entries})


def test_an_honest_source_is_found_honest(known_sources):
    spans = cut(recordings(150))
    (arm,) = score(spans, ScoreConfig(("known:1,1",), offset=(0.0, 0.0))).arms
    expected = (1.0 / (SIGMA_C**2 + SIGMA_E**2 / 11.0) + 1.0 / np.repeat([0.05, 0.3], 3) ** 2) ** -0.5
    np.testing.assert_allclose(arm.over_run.rmse, expected, rtol=0.15)
    np.testing.assert_allclose(arm.over_run.sigma, expected, rtol=0.01)
    np.testing.assert_allclose(arm.over_run.coverage, 0.9, atol=0.075)
    np.testing.assert_allclose(arm.windows.rmse, np.sqrt(SIGMA_C**2 + SIGMA_E**2), rtol=0.15)
    np.testing.assert_allclose(arm.windows.coverage, 0.9, atol=0.05)
    assert np.all(np.less(arm.over_run.low, arm.over_run.rmse) & np.less(arm.over_run.rmse, arm.over_run.high))
    # What a likelihood gains on average is the information gained: ln(prior sd / posterior sd).
    np.testing.assert_allclose(arm.gain, np.log(np.repeat([0.05, 0.3], 3) / expected), atol=0.25)


def test_an_overconfident_source_is_found_out(known_sources):
    spans = cut(recordings(100))
    config = ScoreConfig(("known:1,1", "known:1,0.3"), offset=(0.0, 0.0))
    honest, bold = score(spans, config).arms
    assert max(bold.over_run.coverage) < 0.6
    assert all(a > b for a, b in zip(honest.gain, bold.gain, strict=True))


@pytest.mark.parametrize("gain", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("n", [1, 3, 12])
def test_the_response_is_the_gain(known_sources, gain, n):
    """With next to no start to hold it, an estimate follows an offset as far as the source does."""
    config = ScoreConfig((f"known:{gain},1",), spread=(5.0, 50.0))
    (arm,) = score(cut(recordings(n, seconds=21.0)), config).arms
    np.testing.assert_allclose(arm.response, gain, atol=0.01)
    np.testing.assert_allclose(arm.response_matrix, gain * np.eye(6), atol=0.01)


def test_offsets_tell_axes_apart_and_have_both_signs():
    for count in (1, 3, 8, 20):
        offsets = np.vstack([offsets_of(k, count) for k in range(count)])
        A = np.random.default_rng(count).normal(size=(6, 6))
        np.testing.assert_allclose(slope(offsets, offsets @ A.T), A, atol=1e-9)
        np.testing.assert_allclose(offsets.sum(axis=0), 0.0, atol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 4, 8, 16, 32])
def test_offsets_of_two_axes_are_never_alike(count):
    """Nor is one size asked more often than the other."""
    offsets = np.vstack([offsets_of(k, count, (1.0, 1.0)) for k in range(count)])
    second = offsets.T @ offsets / len(offsets)
    np.testing.assert_allclose(second, (1.0 + 0.25) / 2.0 * np.eye(6), atol=1e-12)


def test_truth_and_constant_are_the_two_ends(tmp_path):
    path = tmp_path / "device.json"
    path.write_text('{"b_g": [0,0,0], "b_a": [0,0,0], "covariance": [1e-2,1e-2,1e-2,1,1,1]}')
    spans = cut(recordings(4))
    (constant,) = score(spans, ScoreConfig((f"constant:{path}",))).arms
    assert constant.response == pytest.approx([0.0] * 6)
    assert constant.silent == 4
    assert constant.windows is None
    truth = np.array([s.bias[-1] for s in spans])
    np.testing.assert_allclose(constant.over_run.rmse, np.sqrt((truth**2).mean(axis=0)))


def test_a_source_that_says_nothing_gains_nothing(tmp_path):
    """The start is carried on by the same random walk with measurements and without."""
    path = tmp_path / "device.json"
    Device(np.zeros(6), np.diag(np.repeat([1e-6, 1e-4], 3)), ("r3",)).write(path)
    walking = ImuNoise(1e-4, 1e-3, 1e-3, 1e-2)
    spans = cut(replace(r, noise=walking) for r in recordings(3, spread=(0.001, 0.01)))
    for device in ("", f"constant:{path}"):
        scores = score(spans, ScoreConfig(("none",), device=device, offset=(0.0, 0.0)))
        assert scores.arms[-1].gain == (0.0,) * 6
        sigma = np.repeat([1e-3, 1e-2] if device else [0.05, 0.3], 3)
        walk = np.repeat([1e-3, 1e-2], 3) ** 2 * scores.seconds
        np.testing.assert_allclose(scores.constant.sigma, np.sqrt(sigma**2 + walk), rtol=1e-6)


def test_a_device_is_joined_in(known_sources, tmp_path):
    path = tmp_path / "device.json"
    Device(np.zeros(6), np.diag(np.repeat([1e-6, 1e-4], 3)), ("r3",)).write(path)
    spans = cut(recordings(20, spread=(0.001, 0.01)))
    scores = score(spans, ScoreConfig(("known:1,1",), device=f"constant:{path}"))
    alone, joined = scores.arms
    assert (alone.arm, joined.arm) == ("known:1,1", f"constant:{path},known:1,1")
    assert (alone.seen, joined.seen) == ((), ("r3",))
    assert all(a < 0.5 * b for a, b in zip(joined.over_run.rmse, alone.over_run.rmse, strict=True))
    np.testing.assert_allclose(joined.over_run.rmse, scores.constant.rmse, rtol=0.2)


def test_a_span_is_a_run_of_its_own():
    long = recording(seconds=130.0)
    spans = cut([long], 60.0)
    assert [(s.begin_ns, len(s.sequence.imu)) for s in spans] == [(1_000_000_000, 1200), (61_000_000_000, 1200)]
    assert len(cut([recording(seconds=60.0)], 60.0)) == 1
    assert [s.begin_ns for s in cut([long], 60.0, skip=20.0)] == [21_000_000_000]
    assert len(cut([long], skip=100.0)[0].sequence.imu) == 600
    for seconds, skip in ((200.0, 0.0), (None, 131.0)):
        with pytest.raises(ConfigError, match="no recording is"):
            cut([long], seconds, skip)


def test_a_source_sees_nothing_early(monkeypatch):
    (span,) = cut([recording()])
    seen = []

    class Watching(Source):
        def poll(self, t_ns):
            given = super().poll(t_ns)
            seen.extend((t_ns - z.t_ns) * 1e-9 for z in given)
            return given

    monkeypatch.setattr(runs, "load_prior", lambda spec, sequence: Watching(sequence, 1.0, 1.0))
    assert len(run("known", span).measurements) == 11
    assert all(2.5 <= delay < 3.1 for delay in seen)


def test_errors_along_and_across_a_direction(known_sources):
    """A body that stands on its x axis: along the force is x; pooled axes are root mean squares."""
    spans = cut(recordings(30))
    axes = axes_of("thrust", spans)
    np.testing.assert_allclose(axes.R_FB[0], [1.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(axes.R_FB @ axes.R_FB.T, np.eye(3), atol=1e-12)
    (plain,) = score(spans, ScoreConfig(("known:1,1",), offset=(0.0, 0.0))).arms
    (along,) = score(spans, ScoreConfig(("known:1,1",), frame="2,0,0", offset=(0.0, 0.0))).arms
    across = [np.hypot(*plain.over_run.rmse[k : k + 2]) / np.sqrt(2.0) for k in (1, 4)]
    np.testing.assert_allclose(
        along.over_run.rmse, [plain.over_run.rmse[0], across[0], plain.over_run.rmse[3], across[1]], rtol=1e-6
    )
    with pytest.raises(ConfigError, match="expected 'imu'"):
        axes_of("up", spans)


def test_tables_hold_every_arm(known_sources):
    scores = score(cut(recordings(8, seconds=21.0)), ScoreConfig(("known:1,1", "none")))
    shown = tables(scores)
    assert [t.title.split(" ")[0] for t in shown] == ["RMSE", "Its", "Offset", "Coverage", "Log", "RMSE", "Coverage"]
    assert [row[0] for row in shown[0].rows] == ["nothing known", "known:1,1", "none (says nothing in 8 runs)"]
    assert shown[0].markdown().count("\n| ") == 5


def test_tables_say_what_was_not_unseen():
    """`window-mean` was calibrated on some simulated recordings."""
    spans = cut([recording("handheld-100061", seconds=21.0), recording("r1", seconds=21.0)])
    scores = score(spans, ScoreConfig(("window-mean", "none"), offset=(0.0, 0.0)))
    assert [a.seen for a in scores.arms] == [("handheld-100061",), ()]
    shown = tables(scores)[0]
    assert [r[0] for r in shown.rows[1:]] == [
        "window-mean (made from 1 of these recordings)",
        "none (says nothing in 2 runs)",
    ]
