"""Feed the filter sample by sample: `python examples/feed.py [RECORDING]`.

Without a recording a simulated flight stands in for the sensors.
"""

import sys
from pathlib import Path

from msckf import Filter
from navcore.readers import open_sequence
from navcore.sequence import Frame
from sim.points import simulate_points

recording = open_sequence(Path(sys.argv[1])) if len(sys.argv) > 1 else simulate_points("quadrotor", seconds=6.0)
vio = Filter(recording.calibration)

for event in recording.events():
    if isinstance(event, Frame):  # of a camera: Frame(t_ns, images={0: ImageArray(picture)})
        answers = vio.add_frame(event)
    else:  # of an IMU: one sample at a time here, but any number will do
        answers = [answer for k in range(len(event)) for answer in vio.add_imu(event[k : k + 1])]
    for estimate in answers:  # of the frames that the IMU now reaches
        line = f"{estimate.t_ns * 1e-9:10.3f} s  {estimate.health.value:12}"
        if estimate.state is not None:
            x, y, z = estimate.state.p_WB
            line += f"  at {x:7.3f} {y:7.3f} {z:7.3f} m, {estimate.used} features used"
        print(line, *estimate.reasons)
