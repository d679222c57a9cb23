"""What scenes cost."""

import time

import numpy as np
import pytest

from navcore.arrays import Vectors
from sim.world import Switches, build, make_layout

pytestmark = pytest.mark.bench


@pytest.mark.parametrize(("scene", "most_s"), [("room", 4.0), ("hall", 12.0), ("corridor", 6.0), ("yard", 8.0)])
@pytest.mark.parametrize("kind", ["flight", "long"])
def test_a_scene_is_built_in_seconds(scene: str, kind: str, most_s: float, paths: dict[str, Vectors]) -> None:
    rng = np.random.default_rng(1)
    start = time.process_time()
    scene_built = build(make_layout(scene, paths[kind], rng), rng)
    assert time.process_time() - start < (most_s if kind == "flight" else max(12.0, most_s))
    assert scene_built.model.ntexdata < 200e6


def test_lamps_switch_within_a_second(paths: dict[str, Vectors]) -> None:
    layout = make_layout("room", paths["flight"], np.random.default_rng(1))
    scene = build(layout, np.random.default_rng(2), switches=Switches.of(4, np.random.default_rng(3)))
    start = time.process_time()
    for k, rgb in scene.relit(np.array([True, False, True, True])):
        scene.model.tex_data[scene.model.tex_adr[k] : scene.model.tex_adr[k] + len(rgb)] = rgb
    assert time.process_time() - start < 1.0
