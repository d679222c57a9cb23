"""The images of a recording as files, made one after the other; what is there already stays."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2

from navcore.arrays import Image
from navcore.errors import DataError
from navcore.sequence import Frame, ImageFile, ImageSource, Sequence
from sim.output.folder import copy_whole, write_whole

Progress = Callable[[int, int], None]
"""Called with the number of images done and of all."""

_BEHIND = 8  # images that may wait to be written while the next ones are made
_PNG = (  # one filter for all rows halves the time to write and takes a third off that to read, for 10 % in size
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP),
)


def image_name(t_ns: int, source: ImageSource) -> str:
    """The file of an image: its stamp; an image that is a file already keeps its kind."""
    return f"{t_ns}{source.path.suffix if isinstance(source, ImageFile) else '.png'}"


def image_path(folder: Path, index: int, t_ns: int, source: ImageSource) -> Path:
    """Where EuRoC's layout has it below `mav0`."""
    return folder / f"cam{index}" / "data" / image_name(t_ns, source)


def write_images(sequence: Sequence, folder: Path, progress: Progress | None = None) -> None:
    """All images, below `folder` (`mav0`): a file is copied byte for byte, anything else becomes a PNG.

    An image is encoded and written while the next one is made. Images that are there are not made again.
    """
    for index in {index for frame in sequence.frames for index in frame.images}:
        (folder / f"cam{index}" / "data").mkdir(parents=True, exist_ok=True)
    total = sum(len(f.images) for f in sequence.frames)
    waiting: deque[Future[None]] = deque()
    done = 0
    with ThreadPoolExecutor(1) as writer:
        for frame in sequence.frames:
            for index, source in sorted(frame.images.items()):
                path = image_path(folder, index, frame.t_ns, source)
                if not path.is_file():
                    waiting.append(_submit(writer, path, source))
                if len(waiting) > _BEHIND:
                    waiting.popleft().result()
                done += 1
                if progress is not None:
                    progress(done, total)
        for future in waiting:
            future.result()


def on_disk(sequence: Sequence, folder: Path) -> Sequence:
    """The recording with the images that `write_images` wrote."""

    def files(frame: Frame) -> dict[int, ImageSource]:
        found: dict[int, ImageSource] = {}
        for index, source in frame.images.items():
            camera = sequence.calibration.cameras[index].camera
            found[index] = ImageFile(image_path(folder, index, frame.t_ns, source), camera.width, camera.height)
        return found

    return replace(sequence, frames=tuple(replace(f, images=files(f)) for f in sequence.frames))


def _submit(writer: ThreadPoolExecutor, path: Path, source: ImageSource) -> "Future[None]":
    if isinstance(source, ImageFile):
        if not source.path.is_file():
            raise DataError(f"{source.path}: no such image")
        return writer.submit(copy_whole, source.path, path)
    return writer.submit(_write_png, path, source.load())


def _write_png(path: Path, image: Image) -> None:
    done, data = cv2.imencode(".png", image, _PNG)
    assert done
    write_whole(path, data.tobytes())
