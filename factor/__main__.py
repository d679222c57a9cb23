"""`python -m factor run`: the smoother on a recording, from its folder to a folder of results."""

import dataclasses
import sys
from pathlib import Path
from typing import Literal

import tyro

from eval.errors import EvalError
from eval.running import Asked, run_recording
from factor.config import Preintegration, SmootherConfig
from factor.smoother import Smoother
from navcore.command_line import command_line
from navcore.prior import PriorMode


def run(
    path: tyro.conf.Positional[Path],
    out: Path,
    prior: str = "none",
    cameras: int | None = None,
    start: float | None = None,
    end: float | None = None,
    init: Literal["auto", "truth"] = "auto",
    prior_mode: PriorMode | None = None,
    prior_weight: float | None = None,
    preintegration: Preintegration | None = None,
    rerun: bool = False,
    rerun_save: Path | None = None,
    config: SmootherConfig = SmootherConfig(),  # noqa: B008
) -> int:
    """Run the smoother on a recording in EuRoC's or TUM-VI's layout.

    Args:
        path: folder of the recording.
        out: folder to write; it must not hold results yet.
        prior: where bias priors come from: none, motion:NAME, ipnet:NAME, constant:FILE.json, file:FILE.csv, truth,
            or a source of another package; a device and a source are joined as constant:FILE.json,SOURCE.
        cameras: how many of the rig's cameras are used; short for --config.cameras.
        start: seconds from the first frame.
        end: seconds from the first frame.
        init: with the filter's first state, or from the truth.
        prior_mode: modelled (the prior's own error is a variable) or plain (the paper's factor on every keyframe);
            short for --config.prior.mode.
        prior_weight: W of the plain mode; short for --config.prior.weight.
        preintegration: bias at which samples are integrated: the estimate, or what the prior said last (the paper's
            figure 2); short for --config.prior.preintegration.
        rerun: show the run in Rerun's viewer, live.
        rerun_save: write it for the viewer, by custom as FILE.rrd.
        config: all settings.
    """
    short = {
        "cameras": cameras,
        "prior.mode": prior_mode,
        "prior.weight": prior_weight,
        "prior.preintegration": preintegration,
    }
    config = config.with_overrides({name: value for name, value in short.items() if value is not None})
    asked = Asked(path, out, prior, start, end, init == "truth", config.cameras, rerun, rerun_save)
    run_recording(
        asked,
        lambda sequence, source, told: Smoother(sequence.calibration, config, source, told),
        dataclasses.asdict(config),
    )
    return 0


def main() -> int:
    """Parse the command line and run it."""
    with command_line(EvalError):
        return int(tyro.extras.subcommand_cli_from_dict({"run": run}, prog="python -m factor"))


if __name__ == "__main__":
    sys.exit(main())
