"""A network's statements on a whole recording, as a file."""

from pathlib import Path

import numpy as np

from ipnet.errors import ConfigError
from ipnet.files import write_text
from ipnet.network_source import make
from navcore.sequence import Sequence

HEADER = "#t_ns,b_gx,b_gy,b_gz,b_ax,b_ay,b_az,s_gx,s_gy,s_gz,s_ax,s_ay,s_az"


def predict(sequence: Sequence, weights: str, out: Path) -> int:
    """Write a row for each statement: its time, b_g [rad/s], b_a [m/s^2], and the sd of the six.

    The sd is of everything that is wrong with a statement, what is constant over a run included.

    Returns:
        how many there are.

    Raises:
        ConfigError: the weights are unknown, or the recording is shorter than a window.
    """
    source = make(weights, sequence)
    source.add_imu(sequence.imu)
    found = source.poll(int(sequence.imu.t_ns[-1]))
    if not found:
        raise ConfigError(f"{sequence.name}: shorter than a window of {source.window_s:.3g} s")
    rows = [HEADER]
    for z in found:
        sigma = np.sqrt(np.diagonal(z.covariance) + np.diagonal(source.constant_covariance))
        rows.append(",".join([str(z.t_ns), *(f"{x:.9g}" for x in (*z.vector, *sigma))]))
    write_text(out, "\n".join(rows) + "\n")
    return len(found)
