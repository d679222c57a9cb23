"""`python -m sim severities`: the scale of severities, measured."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from navcore.readers import open_sequence
from sim.commands.bar import progress_bar
from sim.errors import ConfigError
from sim.severities import real_clip, rendered_clip, report

_START_S, _SECONDS = 8.0, 6.0  # of the rendered flight: in full motion
_HEAD = """# What severities do to feature tracks

Made by `python -m sim severities --recording MH_01_easy --out FILE`. This project's tracker (150 features, KLT with
the gyro's rotation) follows a clip under each kind and severity. On the rendered flight the true flow is known from the
scene; on real images it is that of the clean images, where tracking there and back agrees to 0.3 px. A track survives
if its first step and the one a second later are both within 2 px of the truth; on other things it has not survived.
*Life* is the factor on a mean life of 3 s that explains the losses within 0.25 s; *wrong* is the share of steps that
end more than 2 px off. Kinds that act on frames and stamps leave tracks alone.
"""


@dataclass(frozen=True)
class Severities:
    """Measure what each kind and severity does to feature tracks, on a rendered flight and on real images."""

    out: Path | None = None  # Markdown to write; the terminal without it
    recording: Path | None = None  # a recording with images that is measured, too
    start_s: float = 4.0  # where its clip begins, in seconds from the first frame
    seconds: float = 7.0  # how long it is
    seed: int = 1  # of the flight

    def run(self, console: Console) -> None:
        """Measure and write."""
        if self.out is not None and (not self.out.parent.is_dir() or self.out.is_dir()):
            raise ConfigError(f"{self.out}: expected the name of a file, in a folder that is there")
        if self.recording is not None:
            open_sequence(self.recording)  # a wrong path is said before the minutes that follow
        clips = [(f"A rendered flight (quadrotor, seed {self.seed})", rendered_clip(_START_S, _SECONDS, self.seed))]
        if self.recording is not None:
            title = f"{self.recording.name}, {self.start_s:g} s to {self.start_s + self.seconds:g} s"
            clips.append((title, real_clip(self.recording, self.start_s, self.seconds)))
        pages = [_HEAD]
        for title, clip in clips:
            with progress_bar(console, title, "cells") as progress:
                pages.append(report(clip, title, progress))
        if self.out is None:
            console.print("\n".join(pages), markup=False, highlight=False)
        else:
            self.out.write_text("\n".join(pages))
            console.print(f"wrote {self.out}")
