"""Noise of plain Python with the functions of machine code in place of the C library's."""

import math
from types import SimpleNamespace

from uvms_mj.compiler import libm
from uvms_mj.physics import random


def with_own_functions(monkeypatch):
    own = SimpleNamespace(pi=math.pi, sqrt=math.sqrt, log=libm.log, cos=libm.cos)
    monkeypatch.setattr(random, "math", own)
