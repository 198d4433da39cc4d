"""The command line. Slow imports are inside the functions that need them, so that ``--help`` is quick."""

import atexit
import errno
import gc
import io
import os
import sys
from typing import Any

import click

from .archive import archive
from .bench import bench
from .certify import certify, converge
from .common import EXIT_BAD_INPUT, Stop, end, exit_interrupted
from .experiments import paper, practicality, validate
from .identify import identify
from .listing import controllers, keys, metrics, signals, stages, vehicles
from .logs import export, info, replay
from .new import new
from .plot import compare, plot, video
from .run import run
from .sitl import sitl
from .study import study
from .tune import tune

atexit.register(gc.freeze)  # a last look for garbage takes a tenth of a second, and the process ends


class _Commands(click.Group):
    def invoke(self, ctx: click.Context) -> Any:
        """Handle errors that all commands share: an interrupt, and files that cannot be read or written."""
        Stop()
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            end("interrupted", exit_interrupted())
        except OSError as error:
            if error.errno == errno.EPIPE:  # the reader closed the pipe: click ends quietly
                raise
            place = f"{error.filename}: " if error.filename is not None else ""
            try:
                sys.stdout.flush()
            except OSError:  # so that Python's own flush at exit does not fail too
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, sys.stdout.fileno())
                os.close(nowhere)
            end(f"error: {place}{error.strerror or error}", EXIT_BAD_INPUT)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="uvms-mj")
def main() -> None:
    """A MuJoCo physics testbed for underwater vehicles that must touch things.

    \b
    uvms-mj run --controller gsta         the paper's scenario: push on a wall in an unknown current
    uvms-mj sitl vehicle.model=bluerov2   an autopilot in the loop: the physics of ArduSub, in lockstep
    uvms-mj study mine.toml               many runs: laws to compare, keys that vary
    uvms-mj tune mine.toml                gains for an objective and constraints over a study's runs
    uvms-mj identify mine.toml            coefficients of a vehicle from measurements, with intervals
    uvms-mj paper --out results           the paper's section 5: figures, claims, report
    uvms-mj bench my_law.py:MyLaw         Contact-10: a law on ten tasks, the same for everybody
    uvms-mj practicality --out real       from ideal to real: where each law stops working on a BlueROV2 Heavy
    uvms-mj validate pool --data DIR      runs against a real pool: a floating vehicle whose arm moves
    uvms-mj validate speed                the speed of a real BlueROV2 Heavy by its pilot's axis
    uvms-mj replay runs/.../run.mcap      show one or several logs in Rerun
    uvms-mj video runs/.../run.mcap       a video of a log: the scene, its forces, growing plots
    uvms-mj plot runs/.../run.mcap        plot one or several logs
    uvms-mj compare a.mcap b.mcap         one HTML page that compares logs
    uvms-mj info runs/.../run.mcap        contents of a log, or of an archive
    uvms-mj archive results --out r.zip   all that a reviewer needs to repeat a run, a study or a bench
    uvms-mj export runs/.../run.mcap      the samples as CSV, Parquet, NPZ or MAT
    uvms-mj export fmu push_wall          the plant as an FMU, for Simulink, OSP and others
    uvms-mj export law gsta push_wall     a law as a library in C, for the processor of a vehicle
    uvms-mj converge                      error bars from runs at h, h/2 and h/4
    uvms-mj certify                       allowed and actual rate of change of the disturbance
    uvms-mj controllers                   the laws, their gains, units and defaults
    uvms-mj stages                        guidance, navigation, task, laws and actuation with their settings
    uvms-mj vehicles                      the vehicles with their source, licence and trust
    uvms-mj new law my_law                a commented file of your own: a vehicle, a scenario, a law or another stage
    uvms-mj keys wall                     the keys of a scenario; without a word all of them
    uvms-mj signals law                   signals that a stage receives, signals that a run records
    uvms-mj metrics                       metrics that a study can keep
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # for terminals whose encoding lacks a character
            stream.reconfigure(errors="backslashreplace")
    os.environ["MUJOCO_GL"] = "disable"  # no rendering here, and the search for a display takes time
    os.environ["PYDANTIC_DISABLE_PLUGINS"] = "__all__"  # none is used, and the search takes time


for command in (
    *(run, sitl, study, tune, identify, bench, paper, practicality, validate, converge, certify),
    *(replay, video, plot, compare, info, archive, export),
    *(controllers, stages, vehicles, new, keys, signals, metrics),
):
    main.add_command(command)

__all__ = ["main"]
