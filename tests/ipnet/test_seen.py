"""What a source was made from is known of every source that was made from something."""

import json
from pathlib import Path

import numpy as np
import pytest

import ipnet
from ipnet.device import Device
from ipnet.errors import ConfigError
from ipnet.seen import seen_by
from ipnet.splits import SPLITS

ROOT = Path(ipnet.__file__).parent
CARDS = {
    "ipnet:euroc": ROOT / "weights/euroc/card.json",
    "motion:euroc": ROOT / "motion/models/euroc.json",
    "recursive:euroc": ROOT / "rivals/weights/recursive/euroc/card.json",
    "corrector:euroc": ROOT / "rivals/weights/corrector/euroc/card.json",
}


def device_file(folder, names):
    path = folder / "device.json"
    Device(np.zeros(6), np.eye(6), names).write(path)
    return path


@pytest.mark.parametrize("spec", CARDS)
def test_a_card_says_what_a_source_has_seen(spec, tmp_path):
    card = json.loads(CARDS[spec].read_text())
    assert seen_by(spec) == {*card["training"], *card["validation"]}
    assert seen_by(f"constant:{device_file(tmp_path, ('r',))},{spec}") == {"r", *seen_by(spec)}
    assert seen_by(spec) >= {*SPLITS["euroc"].train, *SPLITS["euroc"].validate}
    assert not seen_by(spec) & {*SPLITS["euroc"].test}


def test_two_joined_have_seen_what_each_has_and_what_joined_them():
    join = json.loads((ROOT / "joins/sim-rover.json").read_text())
    first, second = join["specs"]
    assert seen_by("ipnet+motion:sim-rover") == seen_by(first) | seen_by(second) | {*join["recordings"]}


def test_a_calibration_is_made_from_recordings_too():
    assert seen_by("window-mean") == seen_by("window-mean:generic-5") != frozenset()
    assert seen_by("window-mean:euroc-59") == {*SPLITS["euroc"].train}


def test_what_was_made_from_nothing_has_seen_nothing():
    for spec in ("none", "truth"):
        assert seen_by(spec) == frozenset()


def test_a_device_was_learned_from_the_recordings_that_its_file_names(tmp_path):
    path = device_file(tmp_path, ("a", "b"))
    assert seen_by(f"constant:{path}") == {"a", "b"}
    content = json.loads(path.read_text())
    del content["recordings"]
    path.write_text(json.dumps(content))
    assert seen_by(f"constant:{path}") == frozenset()


def test_an_unknown_name_is_answered_with_the_known():
    for source in ("ipnet", "motion", "ipnet+motion", "window-mean", "recursive", "corrector"):
        with pytest.raises(ConfigError, match=r"'nobody' (is|are) unknown; known are"):
            seen_by(f"{source}:nobody")
