"""What the filter learns of its bias prior: `python examples/prior.py [RECORDING [PRIOR]]`.

A prior's measurement is z = b + c + e: the bias, an error `c` that stays the same through a run, and a short-lived one.
The filter estimates `c` beside the biases, so a prior that is wrong cannot talk it into being sure.
"""

import sys
from pathlib import Path

import numpy as np

from msckf import Filter
from navcore.prior import load_prior
from navcore.readers import open_sequence
from navcore.sequence import Frame
from sim.points import simulate_points

recording = open_sequence(Path(sys.argv[1])) if len(sys.argv) > 1 else simulate_points("quadrotor", seconds=16.0)
prior = load_prior(sys.argv[2] if len(sys.argv) > 2 else "ipnet:sim-quadrotor", recording)
vio = Filter(recording.calibration, prior=prior)

print("what the prior says of itself, sigma of c:", np.sqrt(np.diagonal(prior.constant_covariance)).round(4))
applied = 0
for event in recording.events():
    for estimate in vio.add_frame(event) if isinstance(event, Frame) else vio.add_imu(event):
        known = vio.prior
        if known.applied == applied or known.c is None or known.covariance is None or known.nis is None:
            continue
        applied = known.applied
        print(f"{estimate.t_ns * 1e-9:7.2f} s: measurement {applied}, NIS {known.nis:.1f} (6 expected)")
        print("  c     ", known.c.round(4), "rad/s, m/s^2")
        print("  sigma ", np.sqrt(np.diagonal(known.covariance)).round(4))
