"""Recordings that are interrupted, by Ctrl-C or by a kill, and go on."""

import json
import subprocess
import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from navcore.arrays import Image
from navcore.sequence import ImageSource, Sequence
from sim.errors import ConfigError
from sim.output import FORMATS, write_recording
from sim.output import folder as folder_module
from tests.sim.output.recordings import digest, noise_recording

ORIGIN = {"seed": 0}
EVERY = pytest.mark.parametrize("form", FORMATS)


@dataclass
class Loads:
    """Counts loads; may stop the recording, or be slow."""

    stop_at: int = -1
    error: type[BaseException] = KeyboardInterrupt
    seconds: float = 0.0
    done: int = 0


@dataclass(frozen=True)
class Counted:
    source: ImageSource
    loads: Loads = field(compare=False)

    def load(self) -> Image:
        if self.loads.done == self.loads.stop_at:
            raise self.loads.error
        self.loads.done += 1
        time.sleep(self.loads.seconds)
        return self.source.load()


def counted(loads: Loads, seed: int = 0) -> Sequence:
    made = noise_recording(seed=seed)
    return replace(
        made,
        frames=tuple(replace(f, images={c: Counted(s, loads) for c, s in f.images.items()}) for f in made.frames),
    )


def pngs(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.png"))


@EVERY
def test_what_is_interrupted_goes_on_and_ends_with_the_same_bytes(tmp_path, form):
    write_recording(noise_recording(), tmp_path / "whole", format=form, origin=ORIGIN)
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        write_recording(counted(Loads(stop_at=5)), out, format=form, origin=ORIGIN)
    assert not out.exists()
    assert len(pngs(tmp_path / "out.partial")) == 5
    rest = Loads()
    counts: list[tuple[int, int]] = []
    write_recording(counted(rest), out, format=form, origin=ORIGIN, progress=lambda *x: counts.append(x))
    assert rest.done == 6
    assert counts[-1] == (11, 11)
    assert digest(out) == digest(tmp_path / "whole")
    assert sorted(x.name for x in tmp_path.iterdir()) == ["out", "whole"]


KILLED = """
import sys
from pathlib import Path
from sim.output import write_recording
from tests.sim.output.test_resume import ORIGIN, Loads, counted
write_recording(counted(Loads(seconds=0.1)), Path(sys.argv[1]), format=sys.argv[2], origin=ORIGIN)
"""


@pytest.mark.parametrize("form", ["asl", "ros1"])
def test_a_killed_process_loses_nothing_that_was_whole(tmp_path, form):
    root = Path(__file__).parents[3]
    out = tmp_path / "out"
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(out), form], cwd=root)
    deadline = time.monotonic() + 60.0
    while len(pngs(tmp_path)) < 3 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    assert process.wait() < 0  # it did not come to its end
    before = pngs(tmp_path)
    assert 3 <= len(before) < 11
    last = noise_recording().frames[-1].t_ns
    (tmp_path / "out.partial" / "mav0" / "cam0" / "data" / f"{last}.png.partial").write_bytes(b"half")
    rest = Loads()
    write_recording(counted(rest), out, format=form, origin=ORIGIN)
    assert rest.done == 11 - len(before)
    write_recording(noise_recording(), tmp_path / "whole", format=form, origin=ORIGIN)
    assert digest(out) == digest(tmp_path / "whole")


@pytest.mark.parametrize("form", ["ros1", "ros2"])
def test_a_bag_that_was_interrupted_while_it_was_packed_is_packed_anew(tmp_path, form, monkeypatch):
    write_recording(noise_recording(), tmp_path / "whole", format=form, origin=ORIGIN)
    with monkeypatch.context() as patch:
        patch.setattr("sim.output.recording.write_kalibr", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            write_recording(noise_recording(), tmp_path / "out", format=form, origin=ORIGIN)
    none = Loads(stop_at=0)
    write_recording(counted(none), tmp_path / "out", format=form, origin=ORIGIN)
    assert digest(tmp_path / "out") == digest(tmp_path / "whole")


def interrupt(out: Path, **origin: object) -> None:
    with pytest.raises(KeyboardInterrupt):
        write_recording(counted(Loads(stop_at=5)), out, origin=origin)


def test_another_recording_does_not_go_on_with_it(tmp_path):
    out, partial = tmp_path / "out", tmp_path / "out.partial"
    interrupt(out, seed=3, platform="rover")
    before = digest(partial)
    says = r"out\.partial is an interrupted recording of another origin.*delete it.*it began with {\"seed\": 3}"
    for origin in ({"seed": 4, "platform": "rover"}, None):
        with pytest.raises(ConfigError, match=says if origin else "interrupted recording"):
            write_recording(noise_recording(), out, origin=origin)
    with pytest.raises(ConfigError, match=r'it began with {"format": "asl"}'):
        write_recording(noise_recording(), out, format="ros1", origin={"seed": 3, "platform": "rover"})
    assert digest(partial) == before


def test_other_code_does_not_go_on_with_it(tmp_path, monkeypatch):
    interrupt(tmp_path / "out", **ORIGIN)
    monkeypatch.setattr(folder_module, "_code", lambda: "edited")
    with pytest.raises(ConfigError, match="by other code or libraries"):
        write_recording(noise_recording(), tmp_path / "out", origin=ORIGIN)


def test_without_an_origin_nothing_stays(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        write_recording(counted(Loads(stop_at=5)), tmp_path / "out")
    assert not any(tmp_path.iterdir())
    (tmp_path / "out.partial" / "mav0").mkdir(parents=True)  # a process without an origin was killed
    write_recording(noise_recording(), tmp_path / "out")
    write_recording(noise_recording(), tmp_path / "whole")
    assert digest(tmp_path / "out") == digest(tmp_path / "whole")


@pytest.mark.parametrize("origin", [ORIGIN, None])
def test_two_do_not_write_one_recording_at_a_time(tmp_path, origin):
    out = tmp_path / "out"

    def again(done: int, total: int) -> None:
        with pytest.raises(ConfigError, match=r"out\.partial is being written by another process"):
            write_recording(noise_recording(), out, origin=origin)
        counts.append((done, total))

    counts: list[tuple[int, int]] = []
    write_recording(noise_recording(), out, origin=origin, progress=again)
    assert len(counts) == 11
    write_recording(noise_recording(), tmp_path / "whole", origin=origin)
    assert digest(out) == digest(tmp_path / "whole")


def test_an_error_leaves_nothing_behind(tmp_path):
    for origin in (ORIGIN, None):
        with pytest.raises(RuntimeError):
            write_recording(counted(Loads(stop_at=5, error=RuntimeError)), tmp_path / "out", origin=origin)
        assert not any(tmp_path.iterdir())


def test_the_origin_is_saved_with_the_recording(tmp_path):
    write_recording(noise_recording(0), tmp_path / "out", origin={"seed": 7, "degrade": "fog:1@0-1"})
    saved = json.loads((tmp_path / "out" / "origin.json").read_text())
    assert saved == {"seed": 7, "degrade": "fog:1@0-1", "format": "asl"}
