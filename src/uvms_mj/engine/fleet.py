"""``Fleet``: many runs of one scenario at once, on a GPU or on this processor.

A run of a fleet computes what the engine free_body computes, bit for bit, on a GPU, too: it has the functions of
:mod:`uvms_mj.compiler.libm`, whose bits are the same on every processor.
"""

import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from ..actuation.base import Pwm
from ..compiler.refusals import Untranslatable
from ..errors import Fault, InputError, suggestion
from ..plant.mjcf import Mjcf
from ..quantities import overrides_of
from ..scenario import Scenario
from ..setup.base import Setup
from ..setup.checks import checked
from ..stages.namespace import source_files, without_names
from .engines import FreeEngine
from .native.devices import Gpu, Processor
from .native.fleet_code import LOOK, STEPS, FleetCode, FleetSource, without_addresses
from .native.objects import fingerprint, object_name, recall, remember, uncollected
from .native.run_memory import tables_of
from .simulation import Simulation, valid_scenario

DEVICES: Mapping[str, Callable[[], Any]] = {each.name: each for each in (Gpu, Processor)}
_ADDED = ("stop", "steps")
"""Signals that every fleet has, behind the signals that are asked for."""
_OF_ALL = ("simulation.timestep", "simulation.duration")
"""Keys that can't differ between the runs of a fleet."""
MOST = 10**9
"""Most runs of a fleet."""
LAUNCH_S = 0.25
"""Wall time of a call of the device after which Python looks at signals such as Ctrl-C [s]."""


class NotInFleet(InputError):
    """A scenario that a fleet can't run; the message is the reason."""


class Starts:
    """The records with which the runs of a fleet start, from their scenarios.

    Attributes:
        memory: of a run with the same stages.
        template: the words of a run at its start.
    """

    def __init__(self, scenario: Scenario, mjcf: Mjcf | None = None) -> None:
        """Raises NotInFleet for a scenario that a fleet can't run."""
        self.mjcf = mjcf
        try:
            with Simulation(scenario, engine=FreeEngine.name, mjcf=mjcf, looks=False) as simulation:
                self.setup, self.memory = simulation.setup, simulation.memory
        except InputError as error:
            raise NotInFleet(error.faults, "a fleet") from None
        stages = self.memory.stages
        for stage in stages.running:
            if stage.library is not None:
                raise NotInFleet(f"{stage.stage.label()} has machine code of this machine; write the stage in Python")
            if stage.code is None:
                raise NotInFleet(f"{stage.slow}; a fleet runs compiled stages only")
        if isinstance(scenario.actuation, Pwm):
            name = scenario.actuation.label()
            raise NotInFleet(
                [Fault("actuation.name", f"{name}: a fleet takes no pulse widths from outside; use external")]
            )
        self.external = scenario.controller.external, scenario.actuation.external
        self._tables = self._digest(self.setup)
        self.template = self.of_setup(self.setup)

    @staticmethod
    def _digest(setup: Setup) -> str:
        return fingerprint(
            [part for key, (_, rows) in sorted(tables_of(setup).items()) for part in (key.encode(), rows.tobytes())]
        )

    def of_setup(self, setup: Setup) -> np.ndarray:
        """The words of a run at its start. Raises NotInFleet for a setup of another kind."""
        if self._digest(setup) != self._tables:
            raise NotInFleet("the runs have other tables of effects of the water or motion than the first one")
        try:
            self.memory.begin(setup)
        except InputError as error:
            raise NotInFleet(error.faults) from None
        fixed = self.memory.image.fixed
        fixed = without_addresses(fixed[: len(fixed) // 8 * 8], self.memory.shape, len(self.memory.stages.running))
        return fixed.view(np.int64)

    def of(self, scenario: Scenario) -> np.ndarray:
        """The words of a run of a scenario at its start. Raises InputError as :class:`Simulation`, and NotInFleet."""
        return self.of_setup(checked(valid_scenario(scenario), self.mjcf))

    def rooms(self) -> np.ndarray:
        """The numbers behind the records, which all runs read."""
        return self.memory.image.numbers[len(self.memory.image.fixed) // 8 :]

    def parts(self) -> dict[str, tuple[int, tuple[int, ...], str]]:
        """The signals by name: the first word, the shape, and the kind of the numbers."""
        image = self.memory.image
        own = {"stop": self.memory.run["stop"].reshape(()), "steps": self.memory.run["step"].reshape(())}
        arrays = self.memory.views() | own
        return {name: (image.place(each), each.shape, each.dtype.str) for name, each in arrays.items()}

    def commands(self) -> dict[str, np.ndarray]:
        """The signal that the caller sets between steps: tau_cmd, or the thrusts u."""
        stages = self.memory.stages
        arrays = {"tau_cmd": stages.tau_cmd, "u_cmd": stages.u_cmd}
        return {name: arrays[name] for name, set_ in zip(arrays, self.external, strict=True) if set_}


def code_for(starts: Starts, device: Any, varying: Sequence[int], signals: Sequence[int]) -> FleetCode:
    """The code of a fleet, from disk or compiled. Raises NotInFleet for a stage that it lacks something for."""
    memory, stages = starts.memory, starts.memory.stages
    place = memory.image.place
    given = [place(each) + k for each in starts.commands().values() for k in range(each.size)]
    source = FleetSource(
        memory.shape, stages.running, starts.template.view(np.uint8), [*varying], [*signals], stages.control, given
    )  # fmt: skip
    files = [path.read_bytes() for stage in stages.running if stage.users for path in _files(stage)]
    about = [
        device.target,
        memory.shape,
        [stage.kinds for stage in stages.running],
        source.varying,
        signals,
        given,
    ]
    names = [f"{type(stage.stage).__module__}.{type(stage.stage).__qualname__}" for stage in stages.running]
    kinds = [without_names(name) for name in names]
    name = object_name([b"fleet", source.cells.template.tobytes(), repr((about, kinds)).encode(), *files])
    if (kept := recall(name)) is not None:
        return FleetCode(kept[0], **kept[1])
    try:
        with uncollected():
            code = source.emitted(device.target)
    except Untranslatable as lacking:
        where = f"{lacking.words}: " if lacking.words else ""
        raise NotInFleet(f"its code can't be compiled for many runs at once: {where}{lacking.reason}") from lacking
    remember(name, code.code, {key: value for key, value in vars(code).items() if key != "code"})
    return code


def _files(stage: Any) -> list[Any]:
    return source_files(sys.modules[type(stage.stage).__module__])


class Fleet:
    """Many runs of one scenario, that are stepped together::

        fleet = Fleet(Scenario.load("push_wall"), 100_000)
        fleet.reset({"wall.stiffness": np.geomspace(1e4, 1e6, 100_000)})
        fleet.step(200_000)
        peaks = torch.from_dlpack(fleet.signals["force_peak"])

    With ``controller.name = "external"`` the caller writes :attr:`tau_cmd` between steps, with ``actuation.name``
    "external" the thrusts :attr:`u`, both (n, ...) in the device's memory.

    Args:
        scenario: of all runs; default: the paper's. One free rigid vehicle, as the engine free_body takes it.
        n: number of runs.
        signals: names of the signals to give; default: the motion, the law's command, and the running signals of the
            contact.
        device: "gpu", or "cpu" for the same code on all cores of this machine.
        mjcf: the vehicle's model, in place of the file of ``scenario.vehicle.model``.

    Attributes:
        n, device: as given.
        signals: the signals of the instant in hand by name, (n, ...) arrays in the device's memory. With the device
            "gpu" they are :class:`.native.devices.DeviceArray`, for DLPack, otherwise NumPy arrays; copy what you keep.
            A run that has stopped keeps the values of its last instant that was read.

    Raises:
        InputError: the input is invalid, there is no GPU, or the fleet can't run the scenario.
    """

    def __init__(
        self,
        scenario: Scenario | None = None,
        n: int = 1,
        *,
        signals: Sequence[str] = (),
        device: str = "gpu",
        mjcf: Mjcf | None = None,
    ) -> None:
        if not isinstance(n, int | np.integer) or isinstance(n, bool) or not 1 <= n <= MOST:
            raise InputError([Fault("n", f"{n!r}: must be a positive integer, at most {MOST:,}")])
        if not isinstance(device, str) or device not in DEVICES:
            raise InputError([Fault("device", f"{device!r}; {suggestion(str(device), DEVICES)}")])
        given = [] if signals is None else signals
        if isinstance(given, str) or not isinstance(given, Sequence) or not all(isinstance(x, str) for x in given):
            raise InputError([Fault("signals", f"{signals!r}: must be a list of names")])
        if not isinstance(mjcf, Mjcf | None):
            raise InputError([Fault("mjcf", f"expected an Mjcf, got {mjcf!r}; use Mjcf.find(name or path)")])
        self._begin(DEVICES[device](), Starts(valid_scenario(scenario), mjcf), int(n), given)

    @classmethod
    def of(cls, starts: Starts, n: int, *, signals: Sequence[str] = (), device: str = "gpu") -> "Fleet":
        """A fleet of n runs whose first records are there already."""
        fleet = cls.__new__(cls)
        fleet._begin(DEVICES[device](), starts, n, signals)
        return fleet

    def _begin(self, device: Any, starts: Starts, n: int, signals: Sequence[str]) -> None:
        self.n, self.device, self._device, self._starts = n, device.name, device, starts
        self._parts = self._starts.parts()
        names = [*dict.fromkeys(signals or _usual(self._parts))]
        if unknown := [name for name in names if name not in self._parts]:
            raise InputError([Fault("signals", f"no {each!r}; {suggestion(each, self._parts)}") for each in unknown])
        self._names = [*(name for name in dict.fromkeys(names) if name not in _ADDED), *_ADDED]
        self._timestep = starts.setup.scenario.simulation.timestep
        self._varying = set[int]()
        self._words = np.broadcast_to(self._starts.template, (n, len(self._starts.template)))
        self._columns: list[int] | None = None
        self._code: FleetCode | None = None
        self._rooms = self._device.array(self._starts.rooms().shape) if tables_of(self._starts.setup) else None
        self._launch, self._steps, self._ready, self._closed = 1, 0, False, False
        self.compile_s = 0.0
        self.signals: Mapping[str, Any] = _Signals(self)

    # the start

    def reset(self, overrides: Mapping[str, Any] | None = None, *, seed: Any = None) -> None:
        """Return to the start of all runs.

        Args:
            overrides: dotted keys of the scenario with values, until the next reset: one value for all runs, or an
                array (n, ...) with one for each. Keys of ``vehicle`` may be among them; names of stages may not.
            seed: replaces ``simulation.seed``: one, or an array (n,).

        Raises:
            InputError: a key or value is invalid, or needs another fleet. The fleet is as it was before.
        """
        self._refuse_closed()
        overrides_of(overrides)  # a mapping from keys
        given = dict(overrides or {}) | ({} if seed is None else {"simulation.seed": seed})
        base = self._starts.setup.scenario
        one, each = {}, {}
        for key, value in given.items():
            many = isinstance(value, np.ndarray) and value.ndim > 0 and len(value) == self.n
            (each if many else one)[key] = value
        arrays = {key for key, value in one.items() if isinstance(value, np.ndarray) and value.ndim > 0}
        if wrong := [key for key in arrays if one[key].ndim > 1]:
            raise InputError([Fault(key, f"an array of {self.n} rows, or one value") for key in wrong], "reset")
        if faults := [Fault(key, "all runs of a fleet have one") for key in each if key in _OF_ALL]:
            raise InputError(faults, "reset")
        try:
            base = base.updated(overrides_of(one)) if one else base
        except InputError as error:
            rows = f"; an array with a value for each run has {self.n} rows"
            raise InputError([Fault(f.key, f.message + rows * (f.key in arrays)) for f in error.faults]) from None
        if each:
            self.start_columns(*self._drawn(base, each))
        else:
            start = self._starts.of(base) if one else self._starts.template
            self.start(np.broadcast_to(start, (self.n, len(start))))
        self._timestep = base.simulation.timestep

    def _drawn(self, base: Scenario, each: Mapping[str, np.ndarray]) -> tuple[list[int], np.ndarray]:
        """The words in which the runs differ from the template, and their values (n, m)."""
        found: list[tuple[np.ndarray, np.ndarray]] = []
        for i in range(self.n):
            own = {key: value[i] for key, value in each.items()}
            words = self._starts.of(base.updated(overrides_of(own)))
            columns = np.flatnonzero(words != self._starts.template)
            found.append((columns, words[columns]))
        every = np.unique(np.concatenate([columns for columns, _ in found]))
        values = np.tile(self._starts.template[every], (self.n, 1))
        for row, (columns, own_values) in zip(values, found, strict=True):
            row[np.searchsorted(every, columns)] = own_values
        return every.tolist(), values

    def start(self, words: np.ndarray, varying: set[int] | None = None) -> None:
        """Return to the start of all runs, with the words of :class:`Starts`, (n, ...). ``varying`` are further
        words in which they may differ; the words in which they do are added to it."""
        if varying is not None:
            self._code = self._code if varying == self._varying else None
            self._varying = varying  # also an equal one, to which the words are added
        rows = words if words.strides[0] else words[:1]
        differ = np.zeros(words.shape[1], bool)
        for first in range(0, len(rows), 4096):
            differ |= (rows[first : first + 4096] != self._starts.template).any(axis=0)
        more = set(np.flatnonzero(differ).tolist()) - self._varying
        if more:
            self._varying |= more
            self._code = None
        self._words, self._columns, self._steps, self._ready = words, None, 0, False
        if self._code is not None:
            self._fill()

    def start_columns(self, columns: Sequence[int], words: np.ndarray) -> None:
        """As :meth:`start`, with the words (n, m) of some columns; in all others the runs have the template's."""
        if more := set(columns) - self._varying:
            self._varying |= more
            self._code = None
        self._words, self._columns, self._steps, self._ready = words, [*columns], 0, False
        if self._code is not None:
            self._fill()

    def _compiled(self) -> FleetCode:
        """The code, with its tables filled. Raises NotInFleet."""
        self._refuse_closed()
        if self._code is None:
            begun = time.perf_counter()
            words = [first + k for name in self._names for first, size, _ in [self._place(name)] for k in range(size)]
            code = code_for(self._starts, self._device, sorted(self._varying), words)
            self._entries = self._device.load(code)
            try:
                self._table = self._device.array((len(code.kept), self.n))
                self._out = self._device.array((len(words), self.n))
            except (MemoryError, ValueError, InputError) as error:
                size = 8e-9 * self.n * (len(code.kept) + len(words))
                raise InputError([Fault("n", f"{self.n} runs need {size:.3g} GB of memory ({error})")]) from None
            self._code = code
            self.compile_s = time.perf_counter() - begun
            self._fill()
        return self._code

    def _refuse_closed(self) -> None:
        if self._closed:
            raise InputError("the fleet is closed; make a new one")

    def __reduce__(self) -> NoReturn:
        raise InputError("a fleet can't be copied or sent to another process; make one there")

    def _place(self, name: str) -> tuple[int, int, str]:
        first, shape, kind = self._parts[name]
        return first, math.prod(shape), kind

    def _fill(self) -> None:
        assert self._code is not None
        kept = self._code.kept
        table = np.empty((len(kept), self.n), np.int64)
        place = {word: k for k, word in enumerate(self._columns)} if self._columns is not None else None
        rows = len(kept) - self._code.apart
        apart = table[rows:].reshape(self.n, self._code.apart)
        for k, word in enumerate(kept):
            row = table[k] if k < rows else apart[:, k - rows]
            if place is None:
                row[:] = self._words[:, word]
            else:
                row[:] = self._words[:, place[word]] if word in place else self._starts.template[word]
        self._device.put(table, self._table)
        if self._rooms is not None:
            self._device.put(self._starts.rooms(), self._rooms)

    def _call(self, entry: str, n: int) -> None:
        rooms = 0
        if self._rooms is not None:  # a place counts from the start of the records
            rooms = self._device.address(self._rooms) - 8 * len(self._starts.template)
        self._device.call(self._entries[entry], self._table, rooms, self._out, self.n, n)

    # steps

    def step(self, n: int = 1, progress: Callable[[int], None] | None = None) -> None:
        """Take n time steps in every run that has not stopped. ``progress`` is called with the steps done, some times
        a second."""
        if not isinstance(n, int | np.integer) or isinstance(n, bool) or n < 0:
            raise InputError(f"step: {n!r} is not a number of steps")
        self._compiled()
        self._ready, done = False, 0
        while done < n:
            size, begun = min(self._launch, n - done), time.perf_counter()
            self._call(STEPS, size)
            done, spent = done + size, max(time.perf_counter() - begun, 1e-6)
            self._launch = max(1, min(8 * self._launch, int(LAUNCH_S * size / spent), 1 << 24))
            if progress is not None:
                progress(done)
        self._steps += n

    def finish(self) -> None:
        """Evaluate the instant in hand without a step, so that the running signals have it."""
        self._compiled()
        self._call(LOOK, 1)
        self._ready = True

    def _prepare(self) -> None:
        self._compiled()
        if not self._ready:
            self._call(LOOK, 0)
            self._ready = True

    @property
    def steps(self) -> int:
        """Number of time steps done by the runs that have not stopped."""
        return self._steps

    @property
    def t(self) -> float:
        """Time of the instant in hand [s]."""
        return self._steps * self._timestep

    @property
    def stopped(self) -> np.ndarray:
        """(n,) whether each run has left its bounds, or its law has failed."""
        code = self._compiled()
        fields: Any = self._starts.memory.run.dtype.fields
        row = code.kept.index(fields["stop"][1] // 8)
        view = self._device.view(self._table, row * self.n, (self.n,), (1,), "<i8")
        return np.asarray(view) != 0

    @property
    def tau_cmd(self) -> Any:
        """(n, 6) commanded wrenches [N, N m], in the device's memory. With the controller ``external`` the caller
        writes them between steps. InputError with another controller."""
        return self._command("tau_cmd", "controller")

    @property
    def u(self) -> Any:
        """(n, m) commanded thrusts [N], in the device's memory. With the actuation ``external`` the caller writes them
        between steps. InputError with another actuation."""
        return self._command("u_cmd", "actuation")

    def _command(self, name: str, table: str) -> Any:
        commands = self._starts.commands()
        if name not in commands:
            raise InputError([Fault(f"{table}.name", "the caller sets commands with external only")])
        code, array = self._compiled(), commands[name]
        row = code.kept.index(self._starts.memory.image.place(array))
        return self._device.view(self._table, row * self.n, (self.n, array.size), (1, self.n), "<f8")

    def signal(self, name: str) -> Any:
        """A signal of the instant in hand, (n, ...)."""
        if name not in self._names:
            hint = suggestion(str(name), self._parts)
            hint = "give it in signals=" if isinstance(name, str) and name in self._parts else hint
            raise KeyError(f"no signal {name!r}; {hint}")
        self._prepare()
        row = sum(self._place(each)[1] for each in self._names[: self._names.index(name)])
        _, shape, kind = self._parts[name]
        strides = [self.n * math.prod(shape[k + 1 :]) for k in range(len(shape))]
        return self._device.view(self._out, row * self.n, (self.n, *shape), (1, *strides), kind)

    def table(self) -> np.ndarray:
        """The signals of the instant in hand, (width, n), a copy in this machine's memory: the asked signals, one below
        the other."""
        self._prepare()
        asked = sum(self._place(name)[1] for name in self._names if name not in _ADDED)
        return self._device.get(self._out)[:asked]

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the signals."""
        return tuple(self._names)

    @property
    def code(self) -> bytes:
        """The code of the device: PTX, or an object file of this processor."""
        return self._compiled().code

    def describe(self) -> str:
        """A sentence on the compiled code."""
        code = self._compiled()
        share = f"{code.constants} of {code.words} numbers of a run are constants of the code"
        text = f"{share}, {len(code.kept)} are in the device's memory, {8 * len(code.kept)} bytes a run"
        if self.device == Gpu.name:
            registers, local = self._device.registers(self._entries[STEPS])
            text += f"; {registers} registers and {local} bytes a thread"
        return text

    def close(self) -> None:
        """Free the device's memory, as soon as nobody uses its arrays any more."""
        self._closed, self._code = True, None
        self._table = self._out = self._rooms = None
        self._device.close()

    def __enter__(self) -> "Fleet":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _usual(parts: Mapping[str, Any]) -> list[str]:
    """The signals that a fleet gives if nothing is asked for."""
    wanted = ("t", "p_WB", "quat_WB", "nu", "tau", "tau_cmd", "push", "force_peak", "touches", "first_contact")
    return [name for name in (*wanted, "impulse", "final_impulse", "final_low", "final_high") if name in parts]


class _Signals(Mapping[str, Any]):
    """The signals of a fleet by name."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet

    def __getitem__(self, name: str) -> Any:
        return self._fleet.signal(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._fleet.names)

    def __len__(self) -> int:
        return len(self._fleet.names)

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(str(error)) from None
