"""A law that passes the benchmark's tasks, and that can be wrong in one component of its wrench, for a time."""

WRONG = """
from dataclasses import dataclass
from typing import ClassVar

from uvms_mj import Controller, gain
from uvms_mj.control.laws.terms import add_product, integral_residual


@dataclass(frozen=True)
class Wrong(Controller):
    axis: float = gain(0.0, "1", "component of the wrench that it spoils")
    value: float = gain(0.0, "N, N m", "its command there")
    start: float = gain(100.0, "s", "from then on")
    stop: float = gain(100.0, "s", "until then")
    turns: float = gain(0.0, "1", "1: with the other sign at every second instant")

    states: ClassVar = {"nu_hat": 6, "sigma": 6, "d_hat": 6}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        integral_residual(signals, state.nu_hat, state_dot.nu_hat, state.sigma)
        state.d_hat[:] = 0.0
        add_product(20.0 * signals.M_hat, state.sigma, state.d_hat)
        tau_cmd[:] = signals.tau_nom - state.d_hat
        if gains.start <= signals.t < gains.stop:
            sign = 1.0
            if gains.turns > 0.5 and signals.instant % 2 == 0:
                sign = -1.0
            tau_cmd[int(gains.axis)] = sign * gains.value
"""


def settings(axis, value, start, stop=100.0, turns=0.0):
    """The settings of a law that is wrong so."""
    given = {"axis": float(axis), "value": value, "start": start, "stop": stop, "turns": turns}
    return {f"controller.{name}": number for name, number in given.items()}


FAULTS = {
    "hold.error_N": settings(0, 20.0, 8.0),  # it presses with a force of its own
    "hold.worst_N": settings(0, 60.0, 10.5, 10.6),  # one blow
    "hold.lost_s": settings(0, -50.0, 10.5, 10.7),  # it lets go
    "contact.peak_N": settings(0, 60.0, 1.0, 1.4),  # it runs into the wall
    "hold.path_error_m": settings(1, 15.0, 10.0),  # it lets the friction and itself carry it aside
    "hold.turn_error_deg": settings(5, 6.0, 8.0),  # it turns
    "saturated_s": settings(1, 400.0, 5.0, 7.0, 1.0),  # it shakes beyond the thrusters' limits
    "hold.contacts": settings(5, 8.0, 11.0),  # it lifts a bumper
}
"""For each metric of a criterion a law that is wrong in the way that the metric names."""
AT_TOOL = {
    "hold.path_error_m": settings(2, -15.0, 10.0),  # up and down, along the arm's plane
    "hold.turn_error_deg": settings(4, 3.0, 8.0),
}
"""Those that differ at a tool."""
