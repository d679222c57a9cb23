"""How well biases are known in the dark: `python examples/dark.py STUDY`, the folder of a study with outages.

Medians of a condition's runs: error of the biases (norm) when the dark begins, its rms in the dark's second half, and
how often the source of priors has spoken before it ends.
"""

import sys
from pathlib import Path

import numpy as np

from eval.outcome import load
from sim.degrade.spec import Schedule

found = {}
for record in load(Path(sys.argv[1])).records:
    config = record.config
    outages = [d for d in Schedule.parse(config["source"].get("degrade", "")).degradations if d.kind == "blackout"]
    if not outages or "true_b_a_x" not in record.series:
        continue
    (dark,) = outages
    t_s = record.series["t_s"].to_numpy()
    late = (t_s > (dark.start_s + dark.end_s) / 2) & (t_s <= dark.end_s)
    if not np.isfinite(record.column("b_a")[late]).any():
        continue  # lost
    spoken = sum(record.statements["t_s"] < dark.end_s) if len(record.statements) else 0
    row = [spoken]
    for name in ("b_g", "b_a"):
        error = np.linalg.norm(record.column(name) - record.column(f"true_{name}"), axis=1)
        row += [error[t_s <= dark.start_s][-1], np.sqrt(np.mean(error[late & np.isfinite(error)] ** 2))]
    about = (config["platform"], config["regime"], config["condition"], config["estimator"], config["arm"])
    found.setdefault(about, []).append(row)

if not found:
    sys.exit(f"{sys.argv[1]}: no run through a blackout, on a recording that knows its biases")
for about, rows in found.items():
    spoken, *errors = np.nanmedian(rows, axis=0)
    told = "; ".join("{} {:.5f}, then {:.5f}".format(n, *errors[i : i + 2]) for n, i in (("b_g", 0), ("b_a", 2)))
    print(f"{', '.join(about)} ({len(rows)} runs): {told}; spoken {spoken:g} times")
