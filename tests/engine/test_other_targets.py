"""The closed loop of free_body with its stages as one module, for other processors and for this one."""

import ctypes
import re
from pathlib import Path

import llvmlite.binding as llvm
import numpy as np
import pytest

from symbols import undefined
from uvms_mj import Scenario, Simulation
from uvms_mj.compiler.targets import PTX, WASM, Target
from uvms_mj.engine.native.compilation import link
from uvms_mj.engine.native.other_targets import STEPS, loop_for

LAWS = ["gsta", f"{Path(__file__).parents[2] / 'examples' / 'pd.py'}:Pd"]
MEMORY = {"memcpy", "memmove", "memset"}
LINKER = {"__linear_memory", "__stack_pointer"}
"""What the linker of WebAssembly has."""


def simulation(law):
    return Simulation(Scenario.load("push_wall", {"controller.name": law}), engine="free_body")


@pytest.mark.slow
@pytest.mark.parametrize(("target", "law"), [(PTX, LAWS[0]), (WASM, LAWS[1])], ids=["ptx", "wasm32"])
def test_the_loop_is_emitted_for_another_processor(target, law):
    """It uses no function but those that copy and fill memory, and defines the loop. For aarch64 it is linked so, and
    runs, in :mod:`test_everywhere`."""
    with simulation(law) as run:
        code = loop_for(target, run._memory.shape, run._stages.running)
    assert undefined(code) <= MEMORY | (LINKER if target is WASM else set())
    assert target is PTX or undefined(code)  # or else the parser is blind
    assert STEPS.encode() in code
    if target is PTX:
        text = code.decode()
        assert re.findall(r"^\.visible \.func .* (\w+)\($", text, re.M) == [STEPS]
        assert ".target sm_90" in text
        assert ".callprototype" not in text  # of an indirect call


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_linked_stages_compute_what_stages_called_by_address_do(law):
    """The same module for this processor: 0.6 s with the contact, bit for bit."""
    here = Target(llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())
    runs = [simulation(law), simulation(law)]
    with runs[0] as usual, runs[1] as linked:
        stages = linked._stages
        code = loop_for(here, linked._memory.shape, stages.running)
        (address,) = link(code, [STEPS], undefined(code))
        steps = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 3)(address)
        addresses, numbers = stages.rows["code_at"].copy(), np.arange(1, len(stages.rows) + 1)

        def step(n):
            stages.rows["code_at"] = numbers
            steps(linked._memory.address, n, 1)
            stages.rows["code_at"] = addresses  # for the stages that Python calls before a step

        linked._engine.step = step
        for run in runs:
            run.step(6000)
        for name in ("qpos", "qvel", "qacc"):
            assert np.array_equal(usual._memory.run["plant"][name], linked._memory.run["plant"][name]), name
        assert np.array_equal(usual.signals.tau_cmd, linked.signals.tau_cmd)
