"""The viewer that a run is shown in while it goes on, as the options of a command name it."""

import contextlib
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from .common import Stop
from .options import number

if TYPE_CHECKING:
    from ..engine.vehicle_run import Guide
    from ..records.header import Sink

VIEWERS = ("foxglove", "rerun")


def live_options(function: Callable[..., Any]) -> Any:
    """The options ``--live`` and ``--viewer``, as ``live`` and ``viewer``."""
    help = "Show the run while it goes on: rerun opens its viewer, foxglove is served to Foxglove on this machine."
    live = click.option("--live", type=click.Choice(VIEWERS), metavar="NAME", help=help)
    return live(click.option("--viewer", is_flag=True, help="The same as --live rerun.")(function))


class Live:
    """The viewer of a run, or none.

    Raises:
        InputError: the options contradict each other.
    """

    def __init__(
        self,
        live: str | None,
        viewer: bool,
        speed: str | None = None,
        port: int | None = None,
        host: str | None = None,
    ) -> None:
        from ..errors import InputError

        if viewer and live == "foxglove":
            raise InputError("one viewer at a time, please: --viewer is --live rerun, and --live foxglove is asked for")
        self._name = "rerun" if viewer else live
        given = {"speed": speed, "port": port, "host": host}
        options = [f"--{name}" for name, value in given.items() if value is not None]
        if options and live != "foxglove":
            raise InputError(f"{', '.join(options)}: only with --live foxglove")
        self._given: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        if speed is not None:
            self._given["speed"] = (
                math.inf if speed == "max" else number("--speed", speed, "times real time", 0.01, 100.0)
            )
        self._served: Any = None

    @property
    def asked_for(self) -> bool:
        """Whether a viewer is to show the run."""
        return self._name is not None

    def open(self) -> tuple[list["Sink"], list["Guide"]]:
        """The sinks and the guides of the run: of nobody, of Rerun, or of Foxglove. Raises InputError if the viewer
        can't be opened."""
        if self._name == "rerun":
            from ..views.rerun import LiveView

            return [LiveView()], []
        if self._name is None:
            return [], []
        from ..views.foxglove import Foxglove

        self._served = Foxglove(**self._given, said=lambda text: click.echo(text, err=True))
        return [self._served], [self._served]

    def stay(self, stop: Stop) -> None:
        """Leave the run to be looked at, until the last viewer has gone or a signal comes."""
        if self._served is not None and self._served.watched:
            click.echo(f"the run is over; {self._served.address} stays until its viewers leave, or Ctrl-C", err=True)
            with contextlib.suppress(KeyboardInterrupt):
                stop.heed()
                self._served.wait()

    def close(self) -> None:
        if self._served is not None:
            self._served.close()
