"""What moves and what switches, in images."""

import numpy as np
import pytest

from sim.errors import ConfigError
from sim.motion import Motion
from sim.record import filmed, record
from sim.streams import Streams
from sim.world import make_scene


def test_it_is_the_same_world_with_what_lives_in_it_and_without(flight: Motion) -> None:
    alone = make_scene("room", flight, Streams.of(3).world)
    lively = make_scene("room", flight, Streams.of(3).world, movers=2, switching=True)
    assert lively.layout.blocks == alone.layout.blocks
    assert len(lively.movers) == 2 and lively.switches is not None
    assert alone.movers == () and alone.switches is None
    n = len(alone.model.tex_data)
    on = np.ones(lively.layout.lights, dtype=bool)
    relit = np.concatenate([rgb for _, rgb in lively.relit(on)])
    np.testing.assert_array_equal(relit[:n], alone.model.tex_data)


def test_lamps_switch_only_where_there_are_some(flight: Motion) -> None:
    with pytest.raises(ConfigError, match="'yard' has no lamps"):
        make_scene("yard", flight, Streams.of(3).world, switching=True)
    with pytest.raises(ConfigError, match="things that move and lamps that switch need images"):
        record("quadrotor", 5.0, 1, None, mode="points", movers=2)  # type: ignore[arg-type]


def test_images_show_movers_and_lamps_at_their_time_in_any_order(opengl: None) -> None:
    """Frames are the same whichever was loaded before, and differ from those of the still world where they should."""
    wanted = (20, 110)

    def images(order: tuple[int, ...], **living: int) -> dict[int, np.ndarray]:
        with filmed("handheld", 6.0, 2, moving_start=True, **living) as sequence:  # type: ignore[arg-type]
            return {k: sequence.frames[k].images[0].load().astype(int) for k in order}

    still, lively = images(wanted), images(wanted, movers=5, switching=True)
    again = images(wanted[::-1], movers=5, switching=True)
    for k in wanted:
        np.testing.assert_array_equal(lively[k], again[k])
    darker = [still[k].mean() - lively[k].mean() for k in wanted]
    assert abs(darker[0] - darker[1]) > 1.0
    shown = [np.abs((lively[k] - lively[k].mean()) - (still[k] - still[k].mean())) > 40 for k in wanted]
    assert any(np.count_nonzero(x) > 500 for x in shown)
