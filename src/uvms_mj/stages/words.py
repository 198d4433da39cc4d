"""Keys that a scenario does not have: the key that was meant, from the words of the rooms and the stages in use."""

import difflib
from collections.abc import Collection, Mapping
from typing import Any

from ..errors import suggestion
from .base import Stage
from .loader import Choice


def tables_by_word(choices: Mapping[str, Choice]) -> dict[str, str]:
    """The table of each word for a stage: the name of its room, its noun, and the room's further words."""
    found: dict[str, str] = {}
    for table, choice in choices.items():
        room = choice.base.room
        for word in (room.name, room.noun, *room.words):
            found |= {each: found.get(each, table) for each in (word, f"{word}s")}
    return found


def no_table(table: str, word: str, known: Collection[str], choices: Mapping[str, Choice]) -> str:
    """The error of the key ``table.word``, whose table a scenario does not have; ``known`` are those that it has."""
    meant = tables_by_word(choices).get(table)
    return f"no table {table!r}; {_called(meant, word) if meant else suggestion(table, known)}"


def is_a_table(table: str, value: Any, keys: Collection[str], choice: Choice | None) -> str:
    """The error of a table that is given a value, by its keys and its choice of stages."""
    if choice is not None and isinstance(value, str):
        return f"is a table; {table}.name={value} chooses the {choice.base.room.noun}"
    known = keys if choice is None else ("name", *keys)
    return f"is a table; its keys are {', '.join(f'{table}.{key}' for key in known)}"


def not_dotted(
    word: str, value: Any, keys: Mapping[str, Collection[str]], choices: Mapping[str, Choice], tables: Mapping[str, Any]
) -> str:
    """The error of a key without a dot that is not of the scenario itself. ``keys`` are those of each table without its
    stage's name, and ``tables`` are the tables of the scenario, by their names."""
    if (table := tables_by_word(choices).get(word)) is not None:
        return f"is not a dotted key; {_called(table, 'name')}{f'={value}' if isinstance(value, str) else ''}"
    in_use = {}
    for t, choice in choices.items():
        table = tables[t]
        source = table.source() if isinstance(table, Stage) else table.get("name", choice.default.name)
        in_use[t] = choice.settings(source) or ()
    meant = [f"{t}.{word}" for t, known in {**keys, **in_use}.items() if t and word in known]
    of_the_law = [f"controller.{word}"] if not meant and word not in keys else []
    close = difflib.get_close_matches(word, [f"{t}.{key}" for t, known in keys.items() if t for key in known], 1)
    hint = " or ".join(repr(m) for m in meant or close or of_the_law)
    return f"is not a dotted key{f'; did you mean {hint}?' if hint else ''}"


_SIGNALS = {"force": ("push", "f_contact_W", "force_peak"), "position": ("p_WB",), "time": ("t",), "thrust": ("u",)}
"""The signals of words for them."""


def no_signal(name: object, known: Collection[str]) -> str:
    """The error of a signal that is not among the known ones."""
    meant = [repr(each) for each in _SIGNALS.get(str(name), ()) if each in known]
    hint = f"did you mean {' or '.join(meant)}?"
    return f"no signal {name!r}; {hint if meant else suggestion(str(name), known)}"


def _called(table: str, word: str) -> str:
    return f"the table is called {table}: {table}.{word}"
