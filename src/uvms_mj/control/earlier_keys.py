"""Earlier keys of the impedance task: its gains had their place in [controller]."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from ..errors import Fault
from .task import ImpedanceTask

TASK_KEYS = tuple(f.name for f in dataclasses.fields(ImpedanceTask) if f.name != "period")


def move_task_keys(law: dict[str, Any], task: dict[str, Any], faults: list[Fault]) -> set[str]:
    """Move the gains of the task that have their earlier place in [controller] to [task]. Returns their names."""
    moved = {key for key in TASK_KEYS if key in law}
    for key in moved:
        value = law.pop(key)
        if task.setdefault(key, value) != value:
            other = (
                f"is {task[key]!r}, but controller.{key}, the earlier name of this key, is {value!r}; give one of them"
            )
            faults.append(Fault(f"task.{key}", other))
    return moved


def task_settings(overrides: Mapping[str, Any], faults: list[Fault]) -> tuple[dict[str, Any], set[str]]:
    """The overrides, with the task's keys in place of their earlier names, and the keys that were replaced."""
    law, task = (
        {word: value for key, value in overrides.items() for head, _, word in [key.partition(".")] if head == table}
        for table in ("controller", "task")
    )
    replaced = move_task_keys(law, task, faults)
    settings = {key: value for key, value in overrides.items() if key.removeprefix("controller.") not in replaced}
    return settings | {f"task.{key}": task[key] for key in replaced}, replaced
