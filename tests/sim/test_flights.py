import ast
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import sim.flights
from sim.errors import ConfigError
from sim.flights import code_digest, code_files, flight
from sim.motion import Motion
from sim.platforms import simulate_motion


def assert_same(a: Motion, b: Motion) -> None:
    for field in fields(Motion):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


@pytest.fixture
def physics(monkeypatch: pytest.MonkeyPatch) -> list[tuple[object, ...]]:
    """The arguments of every simulation that was run."""
    calls: list[tuple[object, ...]] = []

    def simulate(*arguments: object) -> Motion:
        calls.append(arguments)
        return simulate_motion(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(sim.flights, "simulate_motion", simulate)
    return calls


def test_a_flight_is_simulated_once_and_comes_back_to_the_last_bit(tmp_path: Path, physics: list) -> None:
    made = flight("quadrotor", 1.0, 7, folder=tmp_path / "flights")
    kept = flight("quadrotor", 1.0, 7, folder=tmp_path / "flights")
    assert len(physics) == 1
    assert_same(made, simulate_motion("quadrotor", 1.0, 7))
    assert_same(kept, made)
    assert not kept.p_WB.flags.writeable
    assert [p.suffix for p in (tmp_path / "flights").iterdir()] == [".npz"]


def test_every_argument_makes_another_flight(tmp_path: Path, physics: list) -> None:
    flight("quadrotor", 1.0, 7, folder=tmp_path)
    flight("quadrotor", 1.5, 7, folder=tmp_path)
    flight("quadrotor", 1.0, 8, folder=tmp_path)
    flight("quadrotor", 1.0, 7, True, folder=tmp_path)
    flight("quadrotor", 1.0, 7, False, "easy", folder=tmp_path)
    flight("quadrotor", 1, 7, folder=tmp_path)
    assert len(physics) == 5
    assert len(list(tmp_path.iterdir())) == 5


@pytest.mark.parametrize("spoil", ["cut", "flipped", "empty", "other"])
def test_a_spoiled_file_is_made_anew(tmp_path: Path, physics: list, spoil: str) -> None:
    made = flight("quadrotor", 1.0, 7, folder=tmp_path)
    (path,) = tmp_path.iterdir()
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    spoiled = {"cut": content[: len(content) // 3], "flipped": content, "empty": b"", "other": b"no motion at all"}
    path.write_bytes(bytes(spoiled[spoil]))
    assert_same(flight("quadrotor", 1.0, 7, folder=tmp_path), made)
    assert len(physics) == 2
    assert_same(flight("quadrotor", 1.0, 7, folder=tmp_path), made)
    assert len(physics) == 2


def test_changed_code_makes_new_flights(tmp_path: Path, physics: list, monkeypatch: pytest.MonkeyPatch) -> None:
    flight("quadrotor", 1.0, 7, folder=tmp_path)
    changed = tmp_path / "controller.py"
    changed.write_text("gain = 2\n")
    files = (*code_files(), changed)
    monkeypatch.setattr(sim.flights, "code_files", lambda: iter(files))
    flight("quadrotor", 1.0, 7, folder=tmp_path)
    assert len(physics) == 2
    digest = code_digest()
    changed.write_text("gain = 3\n")
    assert code_digest() != digest


def test_the_digest_covers_all_that_the_platforms_import() -> None:
    covered = set(code_files())
    assert any(path.suffix == ".xml" for path in covered)
    left, reached = [p for p in covered if p.suffix == ".py"], set()
    while left:
        path = left.pop()
        if path in reached or path.parts[-2:] in (("sim", "__init__.py"), ("navcore", "__init__.py")):
            continue
        reached.add(path)
        for node in ast.walk(ast.parse(path.read_text())):
            base = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names = [a.name for a in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
            for name in (*base, *(f"{b}.{n}" for b in base for n in names), *([] if base else names)):
                if name.split(".")[0] in ("sim", "navcore"):
                    left += _file(name)
    assert reached <= covered, sorted(str(p) for p in reached - covered)


def _file(module: str) -> list[Path]:
    try:
        spec = find_spec(module)
    except ModuleNotFoundError:
        return []
    return [Path(spec.origin)] if spec is not None and spec.origin is not None else []


def test_no_folder_keeps_nothing_and_a_bad_one_is_named(tmp_path: Path, physics: list) -> None:
    assert_same(flight("quadrotor", 1.0, 7), flight("quadrotor", 1.0, 7))
    assert len(physics) == 2
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="file cannot be a folder for flights"):
        flight("quadrotor", 1.0, 7, folder=tmp_path / "file")
    with pytest.raises(ConfigError, match="known are"):
        flight("balloon", 1.0, 7, folder=tmp_path)
