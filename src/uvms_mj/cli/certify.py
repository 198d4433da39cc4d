"""``uvms-mj certify``."""

import json
import sys
from typing import TYPE_CHECKING, Any

import click

from .common import bad_input, end, ended
from .console import Console, facts, print_table, table_of
from .options import command, output_options, run_options
from .run import chosen
from .stop import Stop, exit_interrupted

if TYPE_CHECKING:
    from ..control.theory.certificate import Certificate
    from ..records.trace import Trace
    from ..scenario import Scenario


@command(
    epilog="Exit status: 0 whatever the verdict, 2 bad input, 3 the run was unstable, 130 interrupted (143 by SIGTERM)."
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
            scenario, trace = _load(**asked)
            certificate = _certificate(scenario, trace)
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
        return chosen(arguments, settings, controller, None, None)[0], None
    from ..errors import InputError
    from ..records.trace import Trace

    if arguments or settings or controller is not None:
        raise InputError("--from uses a log unchanged: omit the scenario, the law and the settings")
    trace = Trace.load(log)
    return trace.scenario, trace


def _certificate(scenario: "Scenario", trace: "Trace | None") -> "Certificate":
    """The certificate of the law. Raises InputError if the law has none."""
    from ..errors import InputError
    from ..setup.base import set_up
    from ..stages.loader import Placeholder

    law = scenario.controller
    certificate = set_up(scenario, None if trace is None else trace.header.mjcf).certificate
    if certificate is None:
        hint = "" if trace is not None else "; choose a law that has one, as --controller gsta"
        if isinstance(law, Placeholder):
            hint = ": code from a log is never executed; omit --from, give scenario and --controller FILE.py:LAW"
        raise InputError(f"{law.label()} defines no certificate{hint}")
    return certificate


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
        table = facts("gains for a rate of disturbance")
        table.add_row("rate", f"{rate:g} + {state:g} |s| m/s^3, rad/s^3")
        table.add_row("k_1", f"{k_1:.6g} m^(1/2)/s^(3/2), the smallest that certifies all of k_2/2")
        table.add_row("k_2", f"{k_2:.6g} m/s^3, the smallest for this rate plus {MARGIN:.0%}")
        table.add_row("beta", f"{beta:g} (s/m)^(1/2), as given; not needed for a rate that depends on time alone")
        table.add_row("certified rate", f"{bound:.6g} + {2.0 * beta**2 * bound:.6g} |s| m/s^3, rad/s^3")
        print_table(table)


def _report(certificate: "Certificate", trace: "Trace", console: Console) -> None:
    from ..analysis.disturbance import experienced
    from ..analysis.summary import saturated

    found = experienced(trace)
    report: dict[str, Any] = {
        "scenario": trace.scenario.name,
        "status": trace.status.name,
        "controller": trace.scenario.controller.label(),
        "gains": {name: getattr(certificate, name) for name in ("k_1", "k_2", "beta", "nominal")},
        "certified": {name: getattr(certificate, name) for name in ("rate", "state", "limit")},
        "experienced": None,
        "saturated_s": saturated(trace),
    }
    if isinstance(found, str):
        report |= {"is_certified": None, "verdict": f"no verdict on this scenario: {found}"}
    else:
        import numpy as np

        from ..stages.signals import AXES, FINAL_WINDOW_S

        first = float(trace.first_contact[-1])
        free = found.largest_rate(end=first) if first >= 0.0 else found.largest_rate()
        largest, beyond = found.largest_rate(), found.time_beyond(certificate, trace.s)
        columns = {
            "varphi": np.abs(found.varphi).max(axis=0),
            "rate": largest,
            "rate_before_contact": free,
            "rate_at_end": found.largest_rate(start=float(found.t[-1]) - FINAL_WINDOW_S - 1e-9),
            "margin": certificate.rate - largest,
            "margin_to_limit": certificate.limit - largest,
            "time_beyond_s": beyond,
            "contact_lag": found.contact_lag,
        }
        report["experienced"] = {"axes": list(AXES)} | {name: values.tolist() for name, values in columns.items()}
        report["is_certified"] = bool(certificate.rate > 0.0 and not beyond.any())
        report["verdict"] = _verdict(certificate, largest * found.doubt, beyond, report["saturated_s"])
    if console.as_json:
        click.echo(json.dumps(report, allow_nan=False))
    elif not console.quiet:
        _tables(report)


def _verdict(certificate: "Certificate", largest: Any, beyond: Any, saturated: float) -> str:
    from ..control.theory.certificate import MARGIN, gains_for

    bound = certificate.rate
    if bound == 0.0:
        return "not certified: these gains are not certified for any disturbance"
    if not beyond.any():
        by_state = "" if largest.max() < bound else ", within the state-dependent part of the bound"
        return (
            f"certified: the disturbance changed slowly enough on each axis{by_state}; "
            "s converges in finite time to a band that shrinks with the step"
        )
    from ..stages.signals import AXES

    axes = ", ".join(axis for axis, time in zip(AXES, beyond, strict=True) if time > 0.0)
    sentence = (
        f"not certified: in {axes} the disturbance changed faster than the bound, for up to {beyond.max():.3g} s in "
        "total; s may have left zero during that time"
    )
    if saturated > 0.0:
        return (
            f"{sentence}; thrusters were at their limits for {saturated:.3g} s: the missing thrust counts as "
            "disturbance, and no gain compensates it"
        )
    if not certificate.nominal:
        return sentence
    k_1, k_2 = gains_for(float(largest.max()))
    return f"{sentence}; k_1 = {k_1:.3g} and k_2 = {k_2:.3g} are certified for this rate plus {MARGIN:.0%}"


def _tables(report: dict[str, Any]) -> None:
    from ..analysis.run_table import ROUNDING

    gains, certified, found = report["gains"], report["certified"], report["experienced"]
    table = facts(f"{report['scenario']} · {report['controller']}")
    alone = "" if gains["nominal"] else ", without nominal control"
    table.add_row("gains", f"k_1 = {gains['k_1']:g}, k_2 = {gains['k_2']:g}, beta = {gains['beta']:g}{alone}")
    table.add_row("certified rate", f"|varphi_dot| < {certified['rate']:.6g} + {certified['state']:.6g} |s|")
    table.add_row("limit", f"k_2/2 = {certified['limit']:.6g}, for any k_1 and beta")
    table.add_row("verdict", report["verdict"])
    print_table(table)
    if found is None:
        return
    title = "disturbance varphi of the scenario, eq. (28), and its rate varphi_dot; in m and rad"
    table = table_of(title, "axis", fixed=("axis",))
    heads = {
        "varphi": "|varphi| [1/s^2]",
        "rate": "largest rate [1/s^3]",
        "rate_before_contact": "before contact",
        "rate_at_end": "last 0.5 s",
        "margin": "bound - rate",
        "margin_to_limit": "k_2/2 - rate",
        "time_beyond_s": "above bound [s]",
    }
    for head in heads.values():
        table.add_column(head, justify="right", overflow="fold")
    for i, axis in enumerate(found["axes"]):
        values = (found[name][i] for name in heads)
        table.add_row(axis, *(f"{value:.3g}" if abs(value) >= ROUNDING else "0" for value in values))
    print_table(table)
