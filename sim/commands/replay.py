"""`python -m sim replay`: a real recording, re-rendered."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from rich.console import Console

from sim.commands.bar import progress_bar
from sim.commands.choices import SceneName
from sim.errors import ConfigError
from sim.output import Format, write_recording
from sim.output.recording import check_apart, check_request
from sim.replay import replayed, smooth_truth
from sim.replay.figures import figures
from sim.replay.replay import Vision, frame_stamps
from sim.replay.stamps import open_recording


@dataclass(frozen=True)
class Replay:
    """Give a real recording new eyes: render images along its truth, or see landmarks from there; keep its IMU."""

    recording: tyro.conf.Positional[Path]  # a folder or bag with truth; images are not needed
    out: Path | None = None  # folder to make; new or empty
    scene: SceneName = "room"  # what is around
    mode: Vision = "images"  # rendered images, or tracks of landmarks
    movers: int = 0  # things that move through the scene on paths of their own
    switch_lamps: bool = False  # the scene's lamps go out and on
    degrade: str = ""  # KIND[:SEVERITY]@START-END,... such as low_light:3@20-35, or a benchmark's cell: v1/night
    seed: int = 1  # of the scene and of all that is random in images
    cameras: int = 1  # how many of the recording's cameras
    start: float | None = None  # seconds from the first frame whose pose is known
    end: float | None = None
    report: bool = False  # only say how well truth and IMU agree, a row of docs/replay.md's table
    format: Format = "asl"  # EuRoC's layout, or a ROS bag

    def run(self, console: Console) -> None:
        """Smooth, render, write; or report."""
        if self.report:
            self._report(console)
            return
        if self.out is None:
            raise ConfigError("--out is needed, or --report")
        source = self.recording.resolve()
        name = source.parent.name if source.name == "mav0" else source.name
        asked = {k: str(v) for k, v in vars(self).items() if k not in ("out", "report", "format", "recording")}
        origin = {"recording": name, **asked}
        check_apart(self.recording, self.out)
        check_request(self.out, self.format, origin)
        with replayed(
            self.recording,
            self.scene,
            mode=self.mode,
            degrade=self.degrade,
            seed=self.seed,
            cameras=self.cameras,
            start_s=self.start,
            end_s=self.end,
            movers=self.movers,
            switching=self.switch_lamps,
        ) as sequence:
            for line in sequence.notes:
                console.print(line, markup=False, highlight=False)
            with progress_bar(console, "replaying") as progress:
                write_recording(sequence, self.out, format=self.format, origin=origin, progress=progress)
        console.print(f"replayed {self.out}")

    def _report(self, console: Console) -> None:
        recording, listed = open_recording(self.recording)
        path = smooth_truth(recording)
        stamps, lost = frame_stamps(recording, listed, path)
        f = figures(recording, path, stamps)
        for line in (*path.notes, *lost):
            console.print(line, markup=False, highlight=False)
        row = (
            f"| {recording.name} | {1e3 * f.turn_offset_s:+.2f} / {1e3 * f.shift_offset_s:+.2f} "
            f"| {np.rad2deg(f.tilt_rad):.2f} / {np.rad2deg(f.turn_rad):.2f} "
            f"| {1e3 * f.turn_rms_rad:.2f} / {1e3 * f.shift_rms_m:.2f} (max {1e3 * f.shift_max_m:.0f}) "
            f"| {100 * f.outliers:.1f} | {f.bridged_s:.2f} / {f.left_out_s:.2f} | {1e3 * f.sd_max_m:.1f} "
            f"| {f.frame_px_rms:.3f} / {f.frame_px_max:.3f} | {f.gyro_ratio:.2f} / {f.accelerometer_ratio:.2f} "
            f"| {f.force_slow:.4f} | {'–' if f.reckoning_m is None else f'{f.reckoning_m:.2f}'} |"
        )
        console.print(row, markup=False, highlight=False)
