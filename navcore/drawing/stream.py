"""Where a drawing goes: to a viewer, to a file, or to both."""

from pathlib import Path

from navcore.drawing.layout import layout
from navcore.drawing.sdk import rr
from navcore.errors import ConfigError

_APPLICATION = "msckf-ipnet"
_PATIENCE_S = 10.0


def open_stream(name: str, *, cameras: int, viewer: bool = False, file: Path | None = None) -> rr.RecordingStream:
    """A stream that a `Canvas` draws on.

    Args:
        name: of the run.
        cameras: how many are drawn.
        viewer: open one, or take the one that is open.
        file: recording to write, by custom `NAME.rrd`; an older one is replaced.

    Raises:
        ConfigError: neither viewer nor file, the file's folder does not exist, or no viewer answers.
    """
    if not viewer and file is None:
        raise ConfigError("a drawing goes nowhere: neither viewer nor file")
    if file is not None and not file.absolute().parent.is_dir():
        raise ConfigError(f"{file}: no such folder; a recording is written into an existing one")
    stream = rr.RecordingStream(_APPLICATION)
    stream.set_log_time_enabled(False)  # what is drawn depends on the run alone
    stream.set_log_tick_enabled(False)
    if viewer:
        stream.spawn(connect=False)
    sinks = [*([rr.GrpcSink()] if viewer else []), *([rr.FileSink(file)] if file is not None else [])]
    stream.set_sinks(*sinks, default_blueprint=layout(cameras))
    stream.send_recording_name(name)
    try:
        stream.flush(timeout_sec=_PATIENCE_S)
    except RuntimeError as error:
        stream.set_sinks()
        raise ConfigError("no viewer answers; without a screen, write a file and look at it elsewhere") from error
    return stream
