"""Take the README's picture of the viewer: a run of the paper's scenario in the Rerun window.

    python scripts/picture_viewer.py                    write docs/replay.png
    python scripts/picture_viewer.py a.mcap b.mcap      compare logs
    python scripts/picture_viewer.py --out FILE.png --at 5.3 --size 1280x800

The script needs no display, but it needs a Vulkan driver: Debian's mesa-vulkan-drivers and libvulkan1.
"""

import io
import tempfile
import time
from pathlib import Path

import click
from PIL import Image
from rerun.experimental import ViewerClient

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.cli.logs import labels
from uvms_mj.views import rerun as rerun_view
from uvms_mj.views.rerun.process import free_port, start, stop
from uvms_mj.views.rerun.run import TIMELINE

OUT = Path(__file__).parents[1] / "docs" / "replay.png"
SETTLES_S = 8.0
"""Time until the viewer has closed its welcome messages [s]."""


def picture(recording: Path, size: str, at: float | None) -> Image.Image:
    """Screenshot of a recording in the headless viewer, with the time cursor at ``at`` or at the end."""
    port = free_port()
    process = start(["--headless", "--port", str(port), "--window-size", size], port)
    try:
        client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        client.open(str(recording))
        if at is not None:
            client.set_time(TIMELINE, duration=at, play_state="paused")
        time.sleep(SETTLES_S)
        return Image.open(io.BytesIO(client.take_screenshot()))
    finally:
        stop(process)


@click.command()
@click.argument("logs", nargs=-1, type=click.Path(exists=True, path_type=Path))
@click.option("--out", default=OUT, type=click.Path(path_type=Path), show_default=True)
@click.option("--at", type=float, help="Simulated time of the picture [s]; default: the end.")
@click.option("--size", default="1080x760", show_default=True)
def main(logs: tuple[Path, ...], out: Path, at: float | None, size: str) -> None:
    """Take a picture of the viewer."""
    loaded = [Trace.load(log) for log in logs]
    traces = dict(zip(labels(tuple(map(str, logs)), loaded), loaded, strict=True))
    if not traces:
        traces = {"push_wall": simulate(Scenario.load("push_wall", {"simulation.duration": 12.0}))}
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "run.rrd"
        rerun_view.save(traces, recording)
        window = picture(recording, size, at)
    # the strip above the views is the empty title bar
    window.crop((0, 37, *window.size)).convert("RGB").save(out, optimize=True)
    print(f"{out}: {out.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
