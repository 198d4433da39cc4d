"""Certain bounds of a run: ``uvms-mj certify`` and ``uvms-mj converge``."""

import json
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from .chosen import one_vehicle
from .common import (
    EXIT_BAD_INPUT,
    EXIT_UNSTABLE,
    Console,
    Listing,
    Stop,
    bad_input,
    end,
    ended,
    exit_interrupted,
    facts,
    progress_bar,
    warn,
)
from .options import command, output_options, run_options

if TYPE_CHECKING:
    from ..control.theory.certificate import Certificate
    from ..records.trace import Trace
    from ..scenario import Scenario
    from ..studies.convergence import Convergence


@command(
    epilog="Exit status: 0 whatever the verdict, 2 bad input, 3 the run was unstable, 130 interrupted "
    "(143 SIGTERM, 129 SIGHUP)."
)
@run_options(
    "Use the samples and gains of a log, run.mcap, instead of a new run.",
    laws="gsta, sta, or your own law with a certificate.",
)
@click.option("--rate", type=float, metavar="L", help="Print gains for a rate of disturbance [m/s^3], without a run.")
@click.option("--state", type=float, metavar="L_S", help="Part of the rate that grows with |s| [1/s^2]; needs beta.")
@output_options
def certify(rate: float | None, state: float | None, as_json: bool, quiet: bool, **asked: Any) -> None:
    """Print the rate of disturbance for which GSTA is certain to converge, and the rate in the scenario.

    The bound on the rate comes from a Lyapunov function, given in uvms_mj.control.theory.certificate, and depends only
    on the gains. The rate in the scenario (default: the paper's) is measured in a run.

    \b
    uvms-mj certify
    uvms-mj certify --set controller.k_2=40 --set controller.k_1=9
    uvms-mj certify --from results/run.mcap
    uvms-mj certify --rate 15
    uvms-mj certify --rate 15 --state 1000 --set controller.beta=5
    """
    stop = Stop()
    console = Console(as_json, quiet)
    try:
        with bad_input():
            from ..studies.certified import certificate_of

            scenario, trace = _load(**asked)
            certificate = certificate_of(scenario, trace)
            if rate is not None or state is not None:
                _report_gains(certificate, rate or 0.0, state or 0.0, console)
                return
            if trace is None:
                from ..engine.run import simulate

                with console.running(scenario, stop) as progress:
                    trace = simulate(scenario, progress=progress)
            _report(certificate, trace, console)
    except KeyboardInterrupt:
        end("interrupted before the first step", exit_interrupted())
    sys.exit(ended(trace))


def _load(
    arguments: tuple[str, ...], controller: str | None, settings: tuple[str, ...], log: str | None
) -> "tuple[Scenario, Trace | None]":
    if log is None:
        return one_vehicle(arguments, settings, controller, None)[0], None
    from ..errors import InputError
    from ..records.trace import Trace

    if arguments or settings or controller is not None:
        raise InputError("--from uses a log unchanged: omit the scenario, the law and the settings")
    trace = Trace.load(log)
    return trace.scenario, trace


def _report_gains(gains: "Certificate", rate: float, state: float, console: Console) -> None:
    from ..control.theory.certificate import MARGIN, gains_for, rate_bound
    from ..errors import InputError

    if not gains.nominal:
        raise InputError("--rate: gains are available only for the law with nominal control; omit controller.nominal")
    beta = gains.beta
    k_1, k_2 = gains_for(rate, state, beta)
    bound = rate_bound(k_1, k_2)
    if console.as_json:
        asked = {"rate": rate, "state": state, "beta": beta, "margin": MARGIN}
        certified = {"certified_rate": bound, "certified_state": 2.0 * beta**2 * bound}
        click.echo(json.dumps(asked | {"gains": {"k_1": k_1, "k_2": k_2}} | certified, allow_nan=False))
    elif not console.quiet:
        rows = (
            ("rate", f"{rate:g} + {state:g} |s| m/s^3, rad/s^3"),
            ("k_1", f"{k_1:.6g} m^(1/2)/s^(3/2), the smallest that certifies all of k_2/2"),
            ("k_2", f"{k_2:.6g} m/s^3, the smallest for this rate plus {MARGIN:.0%}"),
            ("beta", f"{beta:g} (s/m)^(1/2), as given; not needed for a rate that depends on time alone"),
            ("certified rate", f"{bound:.6g} + {2.0 * beta**2 * bound:.6g} |s| m/s^3, rad/s^3"),
        )
        facts("gains for a rate of disturbance", rows).show()


def _report(certificate: "Certificate", trace: "Trace", console: Console) -> None:
    from ..studies.certified import report_of

    report = report_of(certificate, trace)
    if console.as_json:
        click.echo(json.dumps(report, allow_nan=False))
    elif not console.quiet:
        _tables(report)


def _tables(report: dict[str, Any]) -> None:
    from ..analysis.summary import ROUNDING

    gains, certified, found = report["gains"], report["certified"], report["experienced"]
    alone = "" if gains["nominal"] else ", without nominal control"
    about = (
        ("gains", f"k_1 = {gains['k_1']:g}, k_2 = {gains['k_2']:g}, beta = {gains['beta']:g}{alone}"),
        ("certified rate", f"|varphi_dot| < {certified['rate']:.6g} + {certified['state']:.6g} |s|"),
        ("limit", f"k_2/2 = {certified['limit']:.6g}, for any k_1 and beta"),
        ("verdict", report["verdict"]),
    )
    facts(f"{report['scenario']} · {report['controller']}", about).show()
    if found is None:
        return
    heads = {
        "varphi": "|varphi| [1/s^2]",
        "rate": "largest rate [1/s^3]",
        "rate_before_contact": "before contact",
        "rate_at_end": "last 0.5 s",
        "margin": "bound - rate",
        "margin_to_limit": "k_2/2 - rate",
        "time_beyond_s": "above bound [s]",
    }
    rows = []
    for i, axis in enumerate(found["axes"]):
        values = (found[name][i] for name in heads)
        rows.append((axis, *(f"{value:.3g}" if abs(value) >= ROUNDING else "0" for value in values)))
    title = "disturbance varphi of the scenario, eq. (28), and its rate varphi_dot; in m and rad"
    Listing(title, ("axis", *heads.values()), rows, right=[*heads.values()], fixed=("axis",)).show()


@command(
    epilog="Exit status: 0 completed, 2 bad input, 3 a run was unstable, 130 interrupted (143 SIGTERM, 129 SIGHUP)."
)
@run_options("Use scenario and vehicle of a log, run.mcap.")
@click.option(
    "-m",
    "--metric",
    "metrics",
    multiple=True,
    metavar="NAME",
    help="A result, by its key in the JSON of uvms-mj run, such as contact.peak_N or final.s; may be repeated; "
    "`list` prints all.",
)
@output_options
def converge(metrics: tuple[str, ...], as_json: bool, quiet: bool, **asked: Any) -> None:
    """Compute error bars for a run's results: repeat the run at h, h/2 and h/4, and extrapolate.

    h is the scenario's time step. The three runs take seven times as long as the first one and write no files.

    \b
    uvms-mj converge
    uvms-mj converge --controller fosm --set wall.stiffness=2e4
    uvms-mj converge --metric contact.peak_N --metric final.s
    uvms-mj converge my_scenario.toml --set simulation.timestep=5e-5
    """
    stop = Stop()
    console = Console(as_json, quiet)
    with bad_input():
        from ..engine.vehicle_run import LawError
        from ..studies.convergence import CONVERGING, DEFAULT, NotCompletedError
        from ..studies.convergence import converge as runs_of

        if "list" in metrics:
            click.echo("\n".join(CONVERGING))
            return
        scenario, mjcf = one_vehicle(**asked)
        try:
            with console.alone(), progress_bar("running", as_json or quiet, stop) as bar:
                found = runs_of(scenario, metrics or DEFAULT, mjcf=mjcf, progress=bar)
        except NotCompletedError as error:
            end(str(error), EXIT_UNSTABLE)
        except LawError as error:
            end(f"error: {error}", EXIT_BAD_INPUT)
    for note in found.notes:
        warn(note)
    if as_json:
        click.echo(json.dumps(_numbers(found), allow_nan=False))
    elif not quiet:
        _print_errors(found)


def _numbers(found: "Convergence") -> dict[str, object]:
    return {
        "scenario": found.scenario.name,
        "controller": found.scenario.controller.label(),
        "timesteps_s": found.timesteps,
        "warnings": found.notes,
        "metrics": [asdict(estimate) for estimate in found.estimates],
    }


def _print_errors(found: "Convergence") -> None:
    heads, *rows = found.table()
    right = [head for head in heads if head.startswith(("h =", "order"))]
    Listing(found.title, heads, rows, right=right, fixed=(heads[0], "tends to"), width=60).show()
