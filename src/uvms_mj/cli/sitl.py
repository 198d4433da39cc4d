"""``uvms-mj sitl``: a run with an autopilot in the loop."""

import contextlib
import math
import sys
from pathlib import Path
from typing import Any

import click

from .chosen import Chosen
from .common import Console, Stop, bad_input
from .folders import output_folder
from .live import Live, live_options
from .options import asked_for, command, path_option, scenario_argument, set_option
from .run import run_and_report


@command(epilog="Exit status: as of uvms-mj run; Ctrl-C ends the session, and its log is whole.")
@scenario_argument
@set_option
@path_option("-o", "--out", metavar="DIR", help="Output folder [default: runs/<time>-<scenario>-<controller>].")
@click.option("--rate", type=float, default=400.0, show_default=True, metavar="HZ", help="Frames a simulated second.")
@click.option("--depth", type=float, default=5.0, show_default=True, metavar="M", help="Depth of the origin of W.")
@click.option(
    "--instance", type=click.IntRange(0, 99), default=0, metavar="N", help="ArduPilot's -I N: port 9002 + 10 N."
)
@click.option("--port", type=click.IntRange(1, 65535), metavar="P", help="UDP port, in place of the instance's.")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on. Beyond this machine's own, others may command; a warning says so.",
)
@click.option("--motors", metavar="1,-2,...", help="Of each thruster its motor, and its sign [default: by geometry].")
@click.option("--engine", metavar="NAME", help="free_body where it can [default], or mujoco.")
@click.option("--log-rate", metavar="HZ|full", help="Samples per second; must divide the step rate [default: 100].")
@live_options
@click.option("-q", "--quiet", is_flag=True, help="Print no progress bar and no table.")
def sitl(
    arguments: tuple[str, ...],
    settings: tuple[str, ...],
    out: str | None,
    rate: float,
    depth: float,
    instance: int,
    port: int | None,
    host: str,
    motors: str | None,
    engine: str | None,
    log_rate: str | None,
    live: str | None,
    viewer: bool,
    quiet: bool,
) -> None:
    """Be the physics of an ArduSub: its pulse widths move a vehicle in our water, in lockstep.

    The plant owns time: it steps when the autopilot has sent a frame, and the autopilot's clock follows the plant's.
    The scenario has wall, current, sensors and thrusters. The log has the pulse widths and the numbers of
    the frames.

    \b
    uvms-mj sitl vehicle.model=bluerov2_heavy
    ardusub -w --model JSON:127.0.0.1 --speedup 1 --home 33.810313,-118.393867,0,0 --defaults sub-6dof.parm
    """
    from ..engine.ardupilot import PORT, ArduPilot, given_motors, motors_of, steps_of
    from ..errors import InputError
    from ..files import locked, remove_if_empty
    from ..scenario import Scenario
    from ..setup.base import set_up
    from ..studies.rows import chosen_engine

    stop, console, files = Stop(), Console(False, quiet), dict[str, Path]()
    status = 0
    with bad_input(), console.alone():
        name, overrides = asked_for(arguments, settings)
        given: dict[str, Any] = {"controller.name": "external", "actuation.name": "autopilot", "thrusters.name": "t200"}
        given |= {"simulation.duration": 3600.0}
        scenario = Scenario.load(name or "push_wall", given | overrides)
        if not (scenario.controller.external and scenario.actuation.name == "autopilot"):
            wrong = "with sitl an autopilot commands: leave out controller.name and actuation.name"
            raise InputError(wrong)
        if not host or not math.isfinite(depth):
            raise InputError("--host must not be empty, and --depth must be a finite number")
        shown = Live(live, viewer, "max" if live == "foxglove" else None)  # the autopilot has the pace
        setup = set_up(scenario)
        frame = "given"
        if motors is not None:
            channels, signs = given_motors(motors, len(setup.vehicle.thrusters))
        else:
            frame, channels, signs = motors_of(setup.vehicle.B)
        steps = steps_of(rate, scenario.simulation.timestep)
        place = PORT + 10 * instance if port is None else port
        folder, made = output_folder(out, scenario)
        with locked(folder), contextlib.closing(shown):
            peer = ArduPilot(channels, signs, steps, depth, place, host)
            try:
                if not quiet:
                    click.echo(
                        f"frame {frame}; waits for an autopilot on UDP {host}:{place}, --model JSON:{host}", err=True
                    )
                found = Chosen(scenario, None, log_rate or "100", engine or chosen_engine(scenario))
                status = run_and_report(found, folder, files, shown, console, stop, peer)
            finally:
                peer.close()
                remove_if_empty(made)
                if not quiet:
                    click.echo(f"autopilot: {peer.counts}; the plant waited {peer.waited_s:.2f} s for them", err=True)
    sys.exit(status)
