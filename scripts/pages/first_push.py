"""docs/start/first_push.md: the table of its run."""

from collections.abc import Iterator

from uvms_mj import Scenario, simulate


def numbers() -> Iterator[tuple]:
    trace = simulate(Scenario.load("push_wall", controller="gsta"), engine="free_body")
    yield "│ {} s ({} touches)", trace.first_contact[-1], trace.touches[-1]
    yield "│ peak force │ {} N", (trace.force_peak[-1], 0.02)
    yield "│ final force │ {} N (settled)", trace.final_impulse[-1] / 0.5
    yield "│ analytic force │ {} N", trace.analytic.force
    yield "│ largest tau │ {} {} {}", *((value, 1e-3 * value) for value in trace.tau_max[-1, :3])
    yield r"10^5\ \mathrm{m/N}} = {}\ \mathrm{N}.", trace.analytic.force
