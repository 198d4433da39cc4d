"""Pictures to a file: MP4 and GIF by ffmpeg, which a wheel brings."""

import contextlib
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from ...errors import InputError, needs_extra
from ...files import atomic_write

_PALETTE = "split[a][b];[a]palettegen=max_colors={colours}:stats_mode=full[p];[b][p]paletteuse=dither={dither}"
CODERS: dict[str, tuple[str, ...]] = {
    "mp4": ("-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20", "-preset", "medium", "-movflags", "+faststart"),
    "gif": (
        "-filter_complex",
        _PALETTE.format(colours=256, dither="bayer:bayer_scale=5:diff_mode=rectangle"),
        "-loop",
        "0",
    ),
}
"""Options of ffmpeg by the ending of the file."""


@contextlib.contextmanager
def encoded(path: Path, width: int, height: int, fps: float) -> Iterator[Callable[[np.ndarray], None]]:
    """A context that yields a function which takes the next picture (height, width, 3). The file appears when it is
    whole.

    Raises InputError if the extra ``video`` is missing, or the file can't be written.
    """
    with needs_extra("video"):
        import imageio_ffmpeg
    kind = path.suffix.lower().removeprefix(".")
    with atomic_write(path) as part, tempfile.TemporaryFile() as said:
        source = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:g}", "-i", "-")
        options = ("-y", "-v", "error", *source, *CODERS[kind], "-map_metadata", "-1", "-f", kind, str(part))
        command = [imageio_ffmpeg.get_ffmpeg_exe(), *options]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said) as process:
            assert process.stdin is not None
            take = process.stdin.write

            def add(pixels: np.ndarray) -> None:
                take(np.ascontiguousarray(pixels).data)

            try:
                yield add
                process.stdin.close()
            except BrokenPipeError:
                pass
            except BaseException:
                process.kill()
                raise
            status = process.wait()
        if status:
            said.seek(0)
            why = said.read().decode(errors="replace").strip().splitlines()
            raise InputError(f"{path}: ffmpeg ended with status {status}: {why[-1] if why else 'without a word'}")
