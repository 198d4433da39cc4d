"""uvms-mj: a MuJoCo physics testbed for underwater vehicles that must touch things.

from uvms_mj import Gsta, Scenario, simulate

trace = simulate(Scenario.load("push_wall"), controller=Gsta(k_1=8.0))
print(trace.push[-1])
"""

from importlib import import_module

TYPE_CHECKING = False  # same as typing.TYPE_CHECKING, without the time to import typing
if TYPE_CHECKING:
    from .control import Controller, Fosm, Gsta, Ideal, Impedance, Sta, gain
    from .convergence import converge
    from .faults import InputError
    from .mcap_log import McapLog
    from .native import Attachment, attach
    from .recording import Status
    from .scenario import Scenario
    from .simulation import LawError, SinkError, simulate
    from .trace import Trace

_HOME = {
    "Attachment": "native",
    "Controller": "control",
    "Fosm": "control",
    "Gsta": "control",
    "Ideal": "control",
    "Impedance": "control",
    "InputError": "faults",
    "LawError": "simulation",
    "McapLog": "mcap_log",
    "Scenario": "scenario",
    "SinkError": "simulation",
    "Sta": "control",
    "Status": "recording",
    "Trace": "trace",
    "attach": "native",
    "converge": "convergence",
    "gain": "control",
    "simulate": "simulation",
}

__all__ = [
    "Attachment",
    "Controller",
    "Fosm",
    "Gsta",
    "Ideal",
    "Impedance",
    "InputError",
    "LawError",
    "McapLog",
    "Scenario",
    "SinkError",
    "Sta",
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
