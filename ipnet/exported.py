"""Networks that were exported, ready to run."""

from pathlib import Path

import onnxruntime

from ipnet.errors import ConfigError


def open_exported(path: Path) -> onnxruntime.InferenceSession:
    """The network in an ONNX file; one thread, so that the same input gives the same bits.

    Raises:
        ConfigError: there is no such file, or it holds no network.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: no such file; expected the network that belongs to the card beside it")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own share no other base
        raise ConfigError(f"{path}: not a network: {error}") from error
