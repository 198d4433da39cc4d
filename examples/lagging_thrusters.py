"""Thrusters with a first-order lag: T u_dot = u_cmd - u, where u_cmd is the thrust of ideal thrusters.

With a lag of 50 ms the law's command comes too late, and the push swings between 1.2 and 1.6 N for the rest of the run.
With 5 ms it rests.

uvms-mj run --set actuation.name=examples/lagging_thrusters.py:LaggingThrusters --set actuation.time_constant=0.05
"""

from dataclasses import dataclass

from uvms_mj import Actuation, setting
from uvms_mj.actuation import pseudo_inverse
from uvms_mj.quantities import Positive


@dataclass(frozen=True)
class LaggingThrusters(Actuation):
    """Thrusters that reach the commanded thrust with a first-order lag."""

    time_constant: Positive = setting(0.02, "s", "time constant T")

    states = {"thrust": "thrusters", "u_cmd": "thrusters"}
    units = {"thrust": "N", "u_cmd": "N"}

    @staticmethod
    def step(settings, state, given, state_dot, u):
        pseudo_inverse(given, u)
        for i in range(u.shape[0]):
            state.u_cmd[i] = u[i]
            state_dot.thrust[i] = (u[i] - state.thrust[i]) / settings.time_constant
            u[i] = state.thrust[i]


if __name__ == "__main__":
    from dataclasses import replace

    from uvms_mj import Scenario, plot, simulate

    scenario, traces = Scenario.load("push_wall", {"wall.stiffness": 2e3}), {}
    for T in (0.005, 0.05):
        traces[f"T = {T} s"] = simulate(replace(scenario, actuation=LaggingThrusters(time_constant=T)))
        last = traces[f"T = {T} s"].between(18.0, 20.0).push
        print(f"T = {T} s: push from {last.min():.3f} to {last.max():.3f} N in the last two seconds")
    force_figure = plot(traces, "force", width=6.5)
    position_figure = plot(traces, "position", width=6.5)
