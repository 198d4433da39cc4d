"""uvms-mj: a MuJoCo physics testbed for underwater vehicles that must touch things.

from uvms_mj import Gsta, Scenario, simulate

trace = simulate(Scenario.load("push_wall"), controller=Gsta(k_1=8.0))
print(trace.push[-1])
"""

from importlib import import_module

TYPE_CHECKING = False  # same as typing.TYPE_CHECKING, without the time to import typing
if TYPE_CHECKING:
    from .control import Controller, Fosm, Gsta, Ideal, Impedance, Sta, gain
    from .engine.native import Attachment, attach
    from .engine.native.plain_stage import StageFault
    from .engine.run import LawError, SinkError, simulate
    from .engine.simulation import Diverged, Simulation
    from .errors import InputError
    from .records.header import Status
    from .records.mcap import McapLog
    from .records.trace import Trace
    from .scenario import Scenario
    from .studies.convergence import converge

_HOME = {
    "Attachment": "engine.native",
    "Controller": "control",
    "Diverged": "engine.simulation",
    "Fosm": "control",
    "Gsta": "control",
    "Ideal": "control",
    "Impedance": "control",
    "InputError": "errors",
    "LawError": "engine.run",
    "McapLog": "records.mcap",
    "Scenario": "scenario",
    "Simulation": "engine.simulation",
    "SinkError": "engine.run",
    "Sta": "control",
    "StageFault": "engine.native.plain_stage",
    "Status": "records.header",
    "Trace": "records.trace",
    "attach": "engine.native",
    "converge": "studies.convergence",
    "gain": "control",
    "simulate": "engine.run",
}

__all__ = [
    "Attachment",
    "Controller",
    "Diverged",
    "Fosm",
    "Gsta",
    "Ideal",
    "Impedance",
    "InputError",
    "LawError",
    "McapLog",
    "Scenario",
    "Simulation",
    "SinkError",
    "Sta",
    "StageFault",
    "Status",
    "Trace",
    "attach",
    "converge",
    "gain",
    "simulate",
]


def __getattr__(name: str) -> object:
    """Import a public name on first use, so that ``uvms-mj --help`` does not wait for numba."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
