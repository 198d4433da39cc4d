"""The shipped vehicle's file, edited as text."""

import re
from pathlib import Path

from uvms_mj import Scenario
from uvms_mj.plant.build import Plant
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.setup.base import set_up

SHIPPED = (Path(__file__).parents[2] / "models" / "bluerov1.xml").read_text()
BLUEROV = re.sub("<!--.*?-->", "", SHIPPED, flags=re.DOTALL)
INERTIAL = '<inertial mass="7.31"'
END = "</mujoco>"


def edited(before: str, after: str) -> str:
    assert BLUEROV.count(before) == 1, before
    return BLUEROV.replace(before, after)


def with_end(text: str) -> str:
    return edited(END, text + END)


def mjcf(text: str, **others: bytes) -> Mjcf:
    return Mjcf("mine.xml", {"mine.xml": text.encode()} | {f"{k}.xml": v for k, v in others.items()})


def plant(text: str, overrides: dict | None = None, **others: bytes) -> Plant:
    return set_up(Scenario.load("push_wall", overrides or {}), mjcf(text, **others)).plant


CUBE = b"v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
