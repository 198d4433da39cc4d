"""How an object shows itself: ``views``, above it, registers the function for its class.

The package says how to import the module that registers (:data:`ABOVE`), and the first call does it. So a run needs no
drawing.
"""

from collections.abc import Callable
from functools import singledispatch
from typing import Any

ABOVE: list[Callable[[], object]] = []
"""Each imports a module that registers."""


@singledispatch
def html(shown: Any) -> str:
    """HTML of an object in a notebook."""
    return _registered(html, shown)


@singledispatch
def figure(shown: Any, *arguments: Any) -> Any:
    """A matplotlib Figure of an object."""
    return _registered(figure, shown, *arguments)


def _registered(function: Any, shown: Any, *arguments: Any) -> Any:
    for register in ABOVE:
        register()
    known = function.dispatch(type(shown))
    if known is function.dispatch(object):
        raise TypeError(f"nothing shows a {type(shown).__name__}")
    return known(shown, *arguments)
