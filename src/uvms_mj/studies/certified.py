"""Which rate of disturbance the gains of a super-twisting law are certified for, and the rate of a run."""

from typing import Any

import numpy as np

from ..analysis.residual import experienced
from ..analysis.summary import saturated
from ..control.theory.certificate import MARGIN, Certificate, gains_for
from ..errors import InputError
from ..records.trace import Trace
from ..scenario import Scenario
from ..setup.base import set_up
from ..stages.signals import AXES, FINAL_WINDOW_S


def certify(trace: Trace) -> dict[str, Any]:
    """Compare the disturbance of a run with the rate that its law is certified for, as ``uvms-mj certify --json``.

    Returns gains, ``certified`` (rate, part of the state, limit), ``experienced`` (by axis), ``is_certified`` and
    ``verdict``, a sentence; in m, rad and s. Raises InputError if the law has no certificate.
    """
    return report_of(certificate_of(trace.scenario, trace), trace)


def certificate_of(scenario: Scenario, trace: Trace | None = None) -> Certificate:
    """The certificate of a scenario's law, with the vehicle of a trace if one is given. Raises InputError if the law
    has none."""
    law = scenario.controller
    certificate = set_up(scenario, None if trace is None else trace.header.mjcf).certificate
    if certificate is None:
        hint = "" if trace is not None else "; choose a law that has one, as --controller gsta"
        if law.of_log:
            hint = ": code from a log is never executed; omit --from, give scenario and --controller FILE.py:LAW"
        raise InputError(f"{law.label()} defines no certificate{hint}")
    return certificate


def report_of(certificate: Certificate, trace: Trace) -> dict[str, Any]:
    """The report of :func:`certify`."""
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
    return report


def _verdict(certificate: Certificate, largest: Any, beyond: Any, saturated: float) -> str:
    bound = certificate.rate
    if bound == 0.0:
        return "not certified: these gains are not certified for any disturbance"
    if not beyond.any():
        by_state = "" if largest.max() < bound else ", within the state-dependent part of the bound"
        return (
            f"certified: the disturbance changed slowly enough on each axis{by_state}; "
            "s converges in finite time to a band that shrinks with the step"
        )
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
