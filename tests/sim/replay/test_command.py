import io
from pathlib import Path

import pytest
from rich.console import Console

from navcore.readers import open_sequence
from sim.commands.replay import Replay
from sim.errors import ConfigError
from sim.motion import Motion
from sim.output import write_recording
from tests.sim.replay.flights import spoil


@pytest.fixture(scope="module")
def folder(flight: Motion, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("real") / "spoilt"
    write_recording(spoil(flight, gap_s=(8.0, 9.0)).recording, out)
    return out


def test_the_report_is_a_row_of_a_table_and_writes_nothing(folder: Path) -> None:
    said = io.StringIO()
    before = set(folder.parent.iterdir())
    Replay(folder, report=True).run(Console(file=said, soft_wrap=True))
    row = said.getvalue().splitlines()[-1]
    assert row.startswith("| spoilt | ")
    turn_offset_ms, _, shift_offset_ms = row.split("|")[2].split()
    assert float(turn_offset_ms) == pytest.approx(4.0, abs=0.5)
    assert float(shift_offset_ms) == pytest.approx(-7.0, abs=0.5)
    assert row.count("|") == 12
    assert "1 gap(s) of truth, up to 1.0" in said.getvalue()
    assert set(folder.parent.iterdir()) == before


def test_it_wants_to_know_where_to_write(folder: Path) -> None:
    with pytest.raises(ConfigError, match="--out is needed"):
        Replay(folder).run(Console(file=io.StringIO()))


def test_it_does_not_write_into_the_recording(folder: Path) -> None:
    with pytest.raises(ConfigError, match="is inside the recording"):
        Replay(folder, folder / "mav0" / "new").run(Console(file=io.StringIO()))


def test_a_replay_on_disk_reads_back(opengl: None, folder: Path, tmp_path: Path) -> None:
    Replay(folder, tmp_path / "out", start=2.0, end=2.1).run(Console(file=io.StringIO()))
    sequence = open_sequence(tmp_path / "out")
    assert len(sequence.frames) == 3
    assert sequence.frames[2].images[0].load().shape == (480, 752)
    real = open_sequence(folder).imu
    kept = real.between(int(sequence.imu.t_ns[0]), int(sequence.imu.t_ns[-1]) + 1)
    assert kept.accel.tobytes() == sequence.imu.accel.tobytes()
