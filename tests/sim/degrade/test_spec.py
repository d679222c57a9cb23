"""The benchmark: frozen, complete, and plain about what does not fit."""

import hashlib
from pathlib import Path

import pytest

from sim.degrade import recipes
from sim.degrade.schedule import GRADED, RENDERED
from sim.degrade.spec import SPECS, Spec
from sim.errors import ConfigError

# A benchmark never changes: other cells or numbers are a new version beside it.
V1 = "4a04cb64ab0b3387669cba5b45091aa280d227c4c2a515c18286ba7a3a40a234"


def test_version_one_is_what_it_was() -> None:
    assert hashlib.sha256(SPECS["v1"].read_bytes()).hexdigest() == V1


def test_version_one_has_every_kind_and_severity_and_long_outages() -> None:
    spec = Spec.load("v1")
    assert {f"{k}-{s}" for k in recipes.RECIPES for s in range(1, 6)} <= spec.cells.keys()
    assert set(recipes.RECIPES) == set(GRADED) - (set(RENDERED) - {"motion_blur"})
    for cell in spec.cells:
        spec.schedule(cell, 120.0).check(120.0)
    lengths = {d.end_s - d.start_s for c in spec.cells if "outage" in c for d in spec.schedule(c, 120.0).degradations}
    assert {5.0, 10.0, 20.0, 30.0} <= lengths


def test_spans_follow_the_recording() -> None:
    spec = Spec.load("v1")
    assert str(spec.schedule("fog-2", 200.0)) == "fog:2@70-130"
    assert str(spec.schedule("outage-10-late", 100.0)) == "blackout@60-70"
    with pytest.raises(ConfigError, match=r"outage-30-late: blackout@60%\+30 needs 63\.0 s, .* 50\.0 s"):
        spec.schedule("outage-30-late", 50.0)


def test_other_recipes_are_another_benchmark(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(recipes.RECIPES, "jpeg", (41, 20, 10, 5, 2))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="would not be the same images"):
        Spec.load("v1")


def test_cells_are_chosen_by_name_or_pattern() -> None:
    spec = Spec.load("v1")
    assert spec.select(()) == tuple(spec.cells)
    assert spec.select(("clean", "fog-*")) == ("clean", *(f"fog-{k}" for k in range(1, 6)))
    with pytest.raises(ConfigError, match="cell 'smog' is not in v1; there are clean, "):
        spec.select(("smog",))


def test_a_bad_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="benchmark 'v9' is unknown; expected v1"):
        Spec.load("v9")
    text = SPECS["v1"].read_text()
    for old, new, message in (
        ("seed:", "sead:", "expected the keys cells, recipes, recovery_s, seed, version"),
        ("fog:2@35%-65%", "fog:2@35%", "is not of the form"),
        ("fog:2@35%-65%", "fog:6@35%-65%", "severity of fog is 6"),
    ):
        mine = tmp_path / "mine.yaml"
        mine.write_text(text.replace(old, new))
        with pytest.raises(ConfigError, match=message):
            Spec.load(str(mine))
