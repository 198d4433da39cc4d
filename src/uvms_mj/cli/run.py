"""``uvms-mj run``: one run, of a vehicle or of a world."""

import contextlib
import json
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .archive import compared
from .chosen import Chosen, changes_of, chosen, of_archive
from .common import (
    EXIT_BAD_INPUT,
    EXIT_UNSTABLE,
    Console,
    Stop,
    bad_input,
    end,
    ended,
    exit_interrupted,
    label_of,
    printable,
    scenarios_of,
    warn,
)
from .folders import RunFolder, log_of, output_folder
from .live import Live, live_options
from .options import command, output_options, path_option, run_options

if TYPE_CHECKING:
    from ..engine.vehicle_run import Changes, Peer
    from ..records.header import Sink
    from ..records.trace import Trace
    from ..scenario import Scenario
    from ..setup.world import World


@command(
    epilog="Exit status: 0 completed, 1 differs from the archive that it repeats, 2 bad input or a law that failed, 3 "
    "unstable, 130 interrupted (143 SIGTERM, 129 SIGHUP)."
)
@run_options(
    "Repeat the run of a log, run.mcap, with its scenario and vehicle; of an archive, FILE.zip, with its laws; with "
    "--row, of a study's folder."
)
@click.option("--row", type=click.IntRange(min=0), metavar="N", help="Repeat this row of the study in --from DIR.")
@path_option("-o", "--out", metavar="DIR", help="Output folder [default: runs/<time>-<scenario>-<controller>].")
@click.option("--log-rate", metavar="HZ|full", help="Samples per second; must divide the step rate [default: 1 kHz].")
@click.option("--engine", metavar="NAME", help="mujoco [default], or free_body: one vehicle without MuJoCo, faster.")
@click.option(
    "--as-deployed", is_flag=True, help="Commands as a real vehicle takes them: late, slow, whole microseconds."
)
@live_options
@click.option("--speed", metavar="N|max", help="With --live foxglove: times real time [default: 1], or as it runs.")
@click.option("--port", type=click.IntRange(0, 65535), metavar="P", help="TCP port of --live foxglove [default: 8765].")
@click.option(
    "--host", metavar="ADDRESS", help="Address of --live foxglove [default: 127.0.0.1]. Others may then connect."
)
@output_options
def run(
    out: str | None,
    log_rate: str | None,
    engine: str | None,
    live: str | None,
    viewer: bool,
    speed: str | None,
    port: int | None,
    host: str | None,
    as_json: bool,
    quiet: bool,
    **asked: Any,
) -> None:
    """Run a scenario: a TOML file, or the name of a built-in one (default: push_wall, the paper's).

    The samples are written to DIR/run.mcap during the run. The log stays readable if the run stops early.

    \b
    uvms-mj run --controller gsta
    uvms-mj run --controller fosm --set controller.epsilon=2e-3 --set wall.stiffness=2e4
    uvms-mj run my_scenario.toml --controller my_law.py:MyLaw --log-rate full --out results
    uvms-mj run --from results/run.mcap --set current.speed=0.3
    uvms-mj run --from study --row 17 --viewer
    uvms-mj run --from run.zip --out repeated
    uvms-mj run --live foxglove
    uvms-mj run --engine free_body
    uvms-mj run --as-deployed vehicle.model=bluerov2_heavy thrusters.voltage=14 thrusters.mixer=linear
    """
    stop, console = Stop(), Console(as_json, quiet)
    scenario: Scenario | World | None = None
    files: dict[str, Path] = {}
    try:
        with bad_input(), console.alone():
            from ..files import locked, remove_if_empty

            shown = Live(live, viewer, speed, port, host)
            again = asked["log"] is not None and asked["log"].lower().endswith(".zip")
            if again:
                out, asked = of_archive(out, asked)
            as_it_was = again and not (
                asked["arguments"] or asked["settings"] or asked["controller"] or asked["as_deployed"]
            )
            found = chosen(**asked, log_rate=log_rate)
            scenario = found.scenario
            if engine is not None:
                found = found._replace(engine=engine)
            changes = () if asked["log"] is None or asked["row"] is not None else changes_of(asked["log"])
            for line in () if quiet else _announced(found, asked["as_deployed"]):
                click.echo(printable(line), err=True)
            folder, made = output_folder(out, scenario)
            with locked(folder), contextlib.closing(shown):
                try:
                    status = run_and_report(found, folder, files, shown, console, stop, changes=changes)
                    if as_it_was and status in (0, EXIT_UNSTABLE):
                        status = compared("run", folder, quiet) or status
                finally:  # within the lock: the folder of another run, which has not written yet, is empty too
                    remove_if_empty(made)
    except KeyboardInterrupt:
        if as_json:
            click.echo(json.dumps(_nothing_ran(scenario, asked["controller"], _existing(files))))
        end("interrupted before the first step", exit_interrupted())
    sys.exit(status)


def _announced(found: Chosen, as_deployed: bool) -> list[str]:
    """The announcement before a run: of a world the loads of its couplings, and of each vehicle the push that its
    thrusters' commands leave of the demanded one, if they are as deployed."""
    from ..control.base import NoClosedForm
    from ..setup.base import set_up
    from ..setup.coupled_rest import coupled_rest
    from ..setup.deployment import resolution
    from ..setup.world import World

    world, said = found.scenario, list[str]()
    if isinstance(world, World) and world.couplings:
        rest = coupled_rest(world)
        known = not isinstance(rest, NoClosedForm)
        said += rest.announced if known else [f"no closed form of the loads: {rest.reason}"]
    for name, scenario in scenarios_of(world).items() if as_deployed else ():
        left = resolution(set_up(scenario, found.mjcf))
        known = not isinstance(left, str)
        text = left.text(getattr(scenario.thrusters, "quantum", 0.0)) if known else f"{_NOT_KNOWN}: {left}"
        said.append(f"{f'{name}, ' if name else ''}as deployed: {text}")
    return said


_NOT_KNOWN = "what is left of the push is not known"


def run_and_report(
    found: Chosen,
    folder: Path,
    files: dict[str, Path],
    shown: Live,
    console: Console,
    stop: Stop,
    peer: "Peer | None" = None,
    changes: "Changes" = (),
) -> int:
    """Run, write and report; return the exit status. The files that the run opens are added to ``files``. ``peer`` is
    as in :func:`uvms_mj.engine.run.simulate`, and ``changes`` are made in the run as :class:`.Again` does."""
    from ..analysis.metrics import AROUND_THE_END_S
    from ..analysis.summary import ending, fluctuates
    from ..engine.run import simulate
    from ..engine.vehicle_run import Again, LawError, SinkError
    from ..errors import InputError
    from ..records.header import Status
    from ..records.mcap import McapLog

    scenarios, error = scenarios_of(found.scenario), ""
    alone = "" in scenarios
    if shown.asked_for and not alone:
        raise InputError("a viewer shows one vehicle during its run; uvms-mj replay DIR shows a world afterwards")
    sinks: dict[str, list[Sink]] = {name: [McapLog(folder / log_of(name))] for name in scenarios}
    next(iter(sinks.values())).insert(0, RunFolder(folder, files, found.scenario, _made_from(scenarios)))
    half = max(AROUND_THE_END_S, 0.5 * found.scenario.simulation.duration)  # for the push's deviation
    given: dict[str, Any] = {"keep_s": half if any(map(fluctuates, scenarios.values())) else AROUND_THE_END_S}
    given |= {"log_rate": found.log_rate, "engine": found.engine, "sinks": sinks}
    if alone:
        viewers, guides = shown.open()
        given |= {"mjcf": found.mjcf, "peer": peer, "guides": [*([Again(changes)] if changes else []), *guides]}
        given["sinks"] = [*viewers, *sinks[""]]  # without a display or a port it fails before anything is written
    try:
        with console.running(found.scenario, stop) as progress:
            made: Any = simulate(found.scenario, progress=progress, **given)
        traces: dict[str, Trace] = {"": made} if alone else made
    except (LawError, SinkError) as raised:
        traces, error = {"" if alone else raised.trace.scenario.vehicle.name: raised.trace}, str(raised)
    except OSError as raised:
        raise InputError(f"{raised.filename or f'--out {folder}'}: {raised.strerror}") from None
    stop.ignore()
    console.report(traces, _report(found.scenario, traces, _existing(files)))
    status = EXIT_BAD_INPUT if error else 0
    if error:
        click.echo(printable(f"error: {error}"), err=True)
    for name, trace in () if error else traces.items():
        whose = f"{name}: " if name else ""
        for note in ending(trace):
            warn(f"{whose}{note}")
        status = max(status, ended(trace, whose))
    if all(trace.status is not Status.interrupted for trace in traces.values()):
        shown.stay(stop)
    return status


def _made_from(vehicles: Iterable[str]) -> list[str]:
    """The names of the files that are made from the logs of a run."""
    from .logs import FORMATS
    from .plot import WHATS

    logs = [Path(log_of(vehicle)) for vehicle in vehicles]
    return [f"{what}.png" for what in WHATS] + [
        log.with_suffix(f".{kind}").name for log in logs for kind in (*FORMATS, "mp4")
    ]


def _report(scenario: "Scenario | World", traces: "Mapping[str, Trace]", files: dict[str, str]) -> dict[str, Any]:
    """The report of ``--json`` of a vehicle's run, or of a world with a report of each vehicle."""
    from ..analysis.summary import summary

    if "" in traces:
        return summary(traces[""], files)
    logs = {name: {"mcap": files[log_of(name)]} if log_of(name) in files else {} for name in traces}
    reports = {name: summary(trace, logs[name]) for name, trace in traces.items()}
    of_all = {kind: file for kind, file in files.items() if kind == "scenario"}
    return {"scenario": scenario.name, "vehicles": reports, "files": of_all}


def _existing(files: dict[str, Path]) -> dict[str, str]:
    return {kind: str(path) for kind, path in files.items() if path.exists()}


def _nothing_ran(scenario: "Scenario | World | None", controller: str | None, files: dict[str, str]) -> dict[str, Any]:
    """The report of a run that was interrupted before its first step."""
    from ..analysis.summary import summary_of_none

    known: dict[str, Any] = {
        "controller": controller,
        "status": "interrupted",
        "message": "interrupted before the first step",
    }
    if scenario is not None:
        known |= {
            "scenario": scenario.name,
            "controller": label_of(scenario),
            "timestep_s": scenario.simulation.timestep,
        }
    return summary_of_none(known, files)
