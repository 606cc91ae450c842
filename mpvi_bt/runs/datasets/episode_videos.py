"""Videos of a dataset: as they were recorded, or scaled to one size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.remote.wire_mapping import resize_with_pad
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.datasets.demonstrations import Demonstrated
from mpvi_bt.runs.recording.demonstration_recorder import CameraVideo


def place_video(episode: Demonstrated, camera: str, size: tuple[int, int] | None, target: Path) -> NDArray[Any]:
    """Write a camera's video, and tell how often each of its channels has each value, (3, 256).

    Args:
        episode: Whose video, found whole.
        camera: Its name.
        size: Height and width [px] that pictures are scaled and padded to, as policies are shown them
            (`remote.wire_mapping`); of that size, or with None, the file is copied.
        target: Where to write.

    Raises:
        UserError: The recorded video cannot be read.
        BackendError: It cannot be encoded anew.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    source, recorded = episode.folder / f"{camera}.mp4", tuple(episode.about.cameras[camera])
    if size is None or size == recorded:
        target.write_bytes(_content(source))
        return np.asarray(episode.frames[f"histogram/{camera}"])
    import imageio_ffmpeg

    video = CameraVideo(target, (*size, 3), episode.about.fps)
    pictures = imageio_ffmpeg.read_frames(str(source), pix_fmt="rgb24")
    next(pictures)  # what the file says of itself
    for content in pictures:
        video.add(resize_with_pad(np.frombuffer(content, np.uint8).reshape(*recorded, 3), *size))
    video.close()
    return video.histogram


def _content(file: Path) -> bytes:
    """A file of an episode. Raises UserError: it was there when it was checked."""
    try:
        return file.read_bytes()
    except OSError as error:
        raise UserError(f"{file}: cannot be read: {(error.strerror or str(error)).lower()}") from None
