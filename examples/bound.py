"""The most that a bias prior can give in the dark: `python examples/bound.py [DARK_S [FLIGHTS [BEGIN_S]]]`.

The filter is told the true biases once a second, as good as exactly: through the dark, and only until it begins. What
is known by then is all that raw IMU data can tell; the rest is how the biases walk on in the dark, and white noise.
"""

import sys

import numpy as np

from eval.metrics import score
from msckf import Filter
from navcore.odometry import run
from navcore.prior import load_prior
from navcore.priors.listed import ListedPrior
from sim.points import simulate_points

EXACT = "truth:2e-5,2e-3"  # rad/s, m/s^2
dark_s, flights, begin_s = (float(x) for x in (*sys.argv[1:], *("20", "6", "45")[len(sys.argv) - 1 :]))

ratios = []
for seed in range(1, round(flights) + 1):
    degrade = f"blackout@{begin_s:g}-{begin_s + dark_s:g}"
    flight = simulate_points("quadrotor", begin_s + dark_s + 5.0, seed, degrade=degrade)
    told = load_prior(EXACT, flight).poll(flight.imu.t_ns[-1])
    dark_ns = flight.frames[0].t_ns + round(begin_s * 1e9)
    ate = []
    for measurements in ([], told, [prior for prior in told if prior.t_ns < dark_ns]):
        result = run(Filter(flight.calibration, prior=ListedPrior(measurements)), flight)
        ate.append(score(result.trajectory, flight.truth)["ate_m"])
    ratios.append(np.array(ate[1:]) / ate[0])
    print(f"seed {seed}: ATE {ate[0]:.3f} m; told throughout {ate[1]:.3f} m; told before {ate[2]:.3f} m")
throughout, before = np.median(ratios, axis=0) - 1.0
print(f"median change: told throughout {throughout:+.0%}, told before {before:+.0%}")
