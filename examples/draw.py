"""Draw a run with Rerun: `python examples/draw.py FILE.rrd [RECORDING]`; `rerun FILE.rrd` shows it.

`python -m msckf run RECORDING --out DIR --rerun` does the same in a viewer that opens. Needs `pip install -e .[viz]`.
"""

import sys
from pathlib import Path

from msckf import Filter
from navcore.drawing import Canvas, Drawn, open_stream
from navcore.odometry import run
from navcore.readers import open_sequence
from sim.points import simulate_points

file = Path(sys.argv[1] if len(sys.argv) > 1 else "run.rrd")
recording = open_sequence(Path(sys.argv[2])) if len(sys.argv) > 2 else simulate_points("quadrotor", seconds=6.0)

stream = open_stream(recording.name, cameras=1, file=file)
canvas = Canvas(stream, recording.calibration, cameras=1, truth=recording.truth)
result = run(Drawn(Filter(recording.calibration), canvas), recording)  # any Odometry with tracks can be drawn
stream.disconnect()
print(f"{len(result.estimates)} frames, {result.completeness:.0%} with a pose: {file}")
