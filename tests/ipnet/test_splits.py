"""Nothing that is tested on was seen before."""

import json
from pathlib import Path

import pytest

import ipnet
from ipnet.errors import ConfigError
from ipnet.splits import SPLITS, Split, leaks, split, unseen_split

ROOT = Path(ipnet.__file__).parent
SHIPPED = sorted(
    path
    for pattern in ("**/weights/**/card.json", "motion/models/*.json", "rivals/calibrations/*.json", "joins/*.json")
    for path in ROOT.glob(pattern)
)


def test_a_split_keeps_its_parts_apart():
    with pytest.raises(ConfigError, match="MH_01_easy: in more than one part"):
        Split(("MH_01_easy",), (), ("MH_01_easy",))
    with pytest.raises(ConfigError, match=r"unknown; known are euroc"):
        split("kitti")


def test_splits_are_the_papers():
    """All that are at hand are used, but for V1_01 and others where table II tests them."""
    everything = {*SPLITS["euroc"].train, *SPLITS["euroc"].validate, *SPLITS["euroc"].test}
    at_hand = everything - {"MH_05_difficult", "V1_02_medium"}
    assert (len(everything), len(at_hand)) == (11, 9)
    for name in ("euroc-rest", "euroc-table2"):
        assert {*SPLITS[name].train, *SPLITS[name].validate, *SPLITS[name].test} == at_hand
    tested = {name for split_of in ("euroc", "euroc-table2", "euroc-rest") for name in SPLITS[split_of].test}
    assert tested == everything
    assert [unseen_split(name)[0] for name in ("MH_05_difficult", "MH_02_easy", "MH_01_easy")] == [
        "euroc",
        "euroc-table2",
        "euroc-rest",
    ]
    assert unseen_split("dataset-room3_512_16") is None


def test_a_leak_is_found():
    seen = ["MH_01_easy", "quadrotor-100001", "quadrotor-200001", "dataset-room3_512_16"]
    assert leaks(seen) == []
    bad = ["V2_01_easy", "dataset-room5_512_16", "handheld-300007", "quadrotor-imu-seed12", "rover-7"]
    assert leaks(seen + bad) == sorted(bad)
    assert leaks(seen, ["euroc-rest"]) == ["MH_01_easy"]


@pytest.mark.parametrize("path", SHIPPED, ids=[f"{p.parent.name}/{p.stem}" for p in SHIPPED])
def test_what_is_shipped_saw_nothing_that_it_is_tested_on(path):
    """A name that begins with a split's name is tested by that split, all others by table I's and TUM-VI's."""
    name = path.parent.name if path.name == "card.json" else path.stem
    own = [s for s in SPLITS if name.removeprefix("paper-").startswith(s)]
    seen = names(json.loads(path.read_text()))
    assert seen, f"{path} does not say what it was made from"
    assert leaks(seen, [max(own, key=len)] if own else ["euroc", "tumvi"]) == []


def names(content):
    """Every text in a file that names a recording, wherever; what it was tested on is no part of it."""
    if isinstance(content, dict):
        return [n for key, value in content.items() if key not in ("test", "tested", "scores") for n in names(value)]
    if isinstance(content, list):
        return [n for value in content for n in names(value)]
    real = {n for s in SPLITS.values() for n in (*s.train, *s.validate, *s.test)}
    simulated = isinstance(content, str) and content.partition("-")[0] in ("quadrotor", "rover", "handheld")
    return [content] if isinstance(content, str) and (content in real or simulated) else []
