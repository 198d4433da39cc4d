"""uvms-mj: a MuJoCo physics testbed for underwater vehicles that must touch things.

from uvms_mj import Gsta, Scenario, simulate

trace = simulate(Scenario.load("push_wall"), controller=Gsta(k_1=8.0))
print(trace.push[-1])
"""

from importlib import import_module

from . import display

_NAMES = {
    "actuation": "Actuation Joints Thrusters",
    "control": "Controller Fosm Gsta Ideal Impedance Sta gain",
    "engine.coupling": "WorldSimulation",
    "engine.fleet": "Fleet",
    "engine.native.attachment": "Attachment attach",
    "engine.native.plain_stage": "StageFault",
    "engine.run": "simulate",
    "engine.simulation": "Diverged Simulation",
    "engine.vehicle_run": "LawError SinkError",
    "errors": "InputError",
    "guidance": "Guidance",
    "navigation": "Encoder Navigation Observer Wrist",
    "physics.coupling": "internal_forces",
    "plant.buoyancy": "Buoyancy Volume",
    "plant.coupling": "Coupling",
    "plant.effect": "Effect",
    "plant.mjcf": "Mjcf",
    "plant.obstacle": "Obstacle",
    "plant.sea": "Sea",
    "plant.tether": "Tether",
    "plant.water": "Current Disturbance Drag Fin NearWall Pad",
    "records.header": "Status",
    "records.mcap": "McapLog",
    "records.trace": "Trace",
    "reproduce.paper.report": "compare",
    "scenario": "Scenario",
    "setup.coupled_rest": "coupled_rest",
    "setup.world": "World",
    "stages.base": "setting",
    "studies.certified": "certify",
    "studies.convergence": "converge",
    "studies.identify": "Identification",
    "studies.study": "Study",
    "studies.tune": "Tuning",
    "views.figures": "plot",
    "views.video": "still video",
}
"""The modules with their public names."""
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
"""The public names, each with its module."""

__all__ = sorted(_HOME)

TYPE_CHECKING = False  # same as typing.TYPE_CHECKING, without the time to import typing
if TYPE_CHECKING:  # the same names, for type checkers; each alias says that the name is public
    from .actuation import Actuation as Actuation
    from .actuation import Joints as Joints
    from .actuation import Thrusters as Thrusters
    from .control import Controller as Controller
    from .control import Fosm as Fosm
    from .control import Gsta as Gsta
    from .control import Ideal as Ideal
    from .control import Impedance as Impedance
    from .control import Sta as Sta
    from .control import gain as gain
    from .engine.coupling import WorldSimulation as WorldSimulation
    from .engine.fleet import Fleet as Fleet
    from .engine.native.attachment import Attachment as Attachment
    from .engine.native.attachment import attach as attach
    from .engine.native.plain_stage import StageFault as StageFault
    from .engine.run import simulate as simulate
    from .engine.simulation import Diverged as Diverged
    from .engine.simulation import Simulation as Simulation
    from .engine.vehicle_run import LawError as LawError
    from .engine.vehicle_run import SinkError as SinkError
    from .errors import InputError as InputError
    from .guidance import Guidance as Guidance
    from .navigation import Encoder as Encoder
    from .navigation import Navigation as Navigation
    from .navigation import Observer as Observer
    from .navigation import Wrist as Wrist
    from .physics.coupling import internal_forces as internal_forces
    from .plant.buoyancy import Buoyancy as Buoyancy
    from .plant.buoyancy import Volume as Volume
    from .plant.coupling import Coupling as Coupling
    from .plant.effect import Effect as Effect
    from .plant.mjcf import Mjcf as Mjcf
    from .plant.obstacle import Obstacle as Obstacle
    from .plant.sea import Sea as Sea
    from .plant.tether import Tether as Tether
    from .plant.water import Current as Current
    from .plant.water import Disturbance as Disturbance
    from .plant.water import Drag as Drag
    from .plant.water import Fin as Fin
    from .plant.water import NearWall as NearWall
    from .plant.water import Pad as Pad
    from .records.header import Status as Status
    from .records.mcap import McapLog as McapLog
    from .records.trace import Trace as Trace
    from .reproduce.paper.report import compare as compare
    from .scenario import Scenario as Scenario
    from .setup.coupled_rest import coupled_rest as coupled_rest
    from .setup.world import World as World
    from .stages.base import setting as setting
    from .studies.certified import certify as certify
    from .studies.convergence import converge as converge
    from .studies.identify import Identification as Identification
    from .studies.study import Study as Study
    from .studies.tune import Tuning as Tuning
    from .views.figures import plot as plot
    from .views.video import still as still
    from .views.video import video as video


display.ABOVE.append(lambda: import_module(".views.notebook", __name__))


def __getattr__(name: str) -> object:
    """Import a public name on first use, so that ``uvms-mj --help`` does not wait for NumPy."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
