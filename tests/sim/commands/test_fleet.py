"""`python -m sim fleet`: whose turn it is, what is kept, and that it is what `record` writes."""

import json
from pathlib import Path

import pytest

from navcore.readers import open_sequence
from sim.errors import ConfigError
from sim.fleet import Fleet, Member
from sim.record import record
from tests.sim.calls import call
from tests.sim.output.recordings import digest

GRADES = ("consumer", "adis16448", "n100", "cheap")
DIFFICULTIES = ("easy", "medium", "difficult")


def fleet(**change: object) -> Fleet:
    whole: dict[str, object] = {
        "platform": "quadrotor",
        "count": 3,
        "first_seed": 7,
        "seconds": 0.5,
        "imu": ("consumer", "cheap"),
        "difficulty": DIFFICULTIES,
        "start": ("moving",),
    }
    return Fleet(**{**whole, **change})  # type: ignore[arg-type]


def test_everything_that_is_listed_takes_turns() -> None:
    still = (*("still",) * 2, *("moving",) * 6)
    members = fleet(count=24, first_seed=100001, imu=GRADES, start=still).members()
    for k, member in enumerate(members):
        grade, difficulty = GRADES[k % 4], DIFFICULTIES[k % 3]
        assert member == Member("quadrotor", 0.5, 100001 + k, grade, difficulty, (k // 2) % 4 != 0)


def test_the_command_writes_what_record_writes_and_keeps_what_is_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    out = tmp_path / "fleet"
    asked = (
        "fleet",
        "--out",
        out,
        "--first-seed",
        7,
        "--seconds",
        0.5,
        "--imu",
        "consumer",
        "cheap",
        "--start",
        "moving",
    )
    assert call(monkeypatch, *asked, "--count", 1) == 0
    before = (out / "quadrotor-7" / "origin.json").stat().st_mtime_ns
    assert call(monkeypatch, *asked, "--count", 2, "--workers", 2) == 0
    assert sorted(p.name for p in out.iterdir()) == ["quadrotor-7", "quadrotor-8"]
    assert (out / "quadrotor-7" / "origin.json").stat().st_mtime_ns == before
    record("quadrotor", 0.5, 8, tmp_path / "one", mode="imu", imu="cheap", difficulty="medium", moving_start=True)
    assert digest(out / "quadrotor-8") == digest(tmp_path / "one")
    assert len(open_sequence(out / "quadrotor-8").imu) == 100


def test_interrupted_it_has_whole_recordings_and_goes_on(tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        told.append((done, total))
        if done == 1:
            raise KeyboardInterrupt

    told: list[tuple[int, int]] = []
    many = fleet(count=8)
    with pytest.raises(KeyboardInterrupt):
        many.write(tmp_path, progress=stop)
    assert told == [(0, 8), (1, 8)]
    there = list(tmp_path.iterdir())
    assert len(there) < 8 and all(len(open_sequence(path).imu) == 100 for path in there)
    told.clear()
    many.write(tmp_path, progress=lambda done, total: told.append((done, total)))
    assert told[0] == (len(there), 8) and told[-1] == (8, 8)


def test_another_recording_in_its_place_is_named_before_work_begins(tmp_path: Path) -> None:
    fleet(count=1).write(tmp_path)
    with pytest.raises(ConfigError, match=r"quadrotor-7 is another recording: \{'seconds': 0.5\}"):
        fleet(seconds=1.0).write(tmp_path)
    other = tmp_path / "quadrotor-9"
    other.mkdir()
    for content in ("", json.dumps({"platform": "quadrotor"})):
        (other / "origin.json").write_text(content)
        with pytest.raises(ConfigError, match="quadrotor-9 is"):
            fleet().write(tmp_path)
    assert not (tmp_path / "quadrotor-8").exists()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"count": 0}, "count is 0, expected 1 or more"),
        ({"platform": "boat"}, "platform is boat; known are .*quadrotor"),
        ({"difficulty": ("wild",)}, "difficulty is wild; known are easy, medium, difficult"),
        ({"difficulty": ()}, "difficulty is empty; known are"),
        ({"start": ("flying",)}, "start is flying; known are still, moving"),
        ({"imu": ()}, "imu is empty"),
        ({"imu": ("gold",)}, "gold"),
    ],
)
def test_a_fleet_that_cannot_be_is_named(change: dict[str, object], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        fleet(**change)


def test_no_workers_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="workers is 0"):
        fleet().write(tmp_path / "x", workers=0)
    assert not (tmp_path / "x").exists()
