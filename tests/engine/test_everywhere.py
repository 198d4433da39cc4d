"""A run has the same bits on processors that round by other libraries: without fused multiply-adds, and on aarch64."""

import hashlib
import math
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uvms_mj import Scenario, Simulation
from uvms_mj.compiler.targets import AARCH64
from uvms_mj.engine.native.other_targets import loop_for
from uvms_mj.engine.plant_fmu import _Parts

NEAR = {"initial.position": [0.9995, 0.0, 0.0], "initial.velocity": [0.1, 0.02, 0.0, 0.0, 0.1, 0.0]}
RUNS = {
    "gusts": ("push_wall_gusts", {}, "free_body"),
    "T200": ("push_wall", {"vehicle.model": "bluerov2_heavy", "thrusters.name": "t200"}, "free_body"),
    "a filter": ("push_wall", {"navigation.name": "ekf"}, "free_body"),
    "a sea": (
        "push_wall",
        {"sea.height": 0.3, "sea.period": 4.0, "sea.depth": 10.0, "sea.surface": 2.0, "current.speed": 0.0},
        "free_body",
    ),
    "in MuJoCo": ("push_wall", {}, "mujoco"),
}
LACKING = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX512F,-AVX512VL,-AVX512DQ,-AVX512BW",
    "NPY_DISABLE_CPU_FEATURES": "FMA3 AVX2 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR",
}
"""Of a processor with less: what glibc and NumPy then do not use."""


def digests() -> list[str]:
    """Digests of all signals after 0.6 s of each run, with the touch."""
    found = []
    for scenario, overrides, engine in RUNS.values():
        with Simulation(Scenario.load(scenario, NEAR | overrides), engine=engine, looks=False) as run:
            run.step(6000)
            assert run.signals.force_peak > 0.0
            numbers = b"".join(np.asarray(run.signals[name]).tobytes() for name in run.signals)
        found.append(hashlib.sha256(numbers).hexdigest())
    return found


def sine_of_numpy_and_c() -> str:
    x = np.linspace(0.0, 30.0, 40_001)
    return hashlib.sha256(np.exp(-x).tobytes() + b"".join(math.cos(each).hex().encode() for each in x)).hexdigest()


@pytest.mark.skipif(sys.platform != "linux" or os.uname().machine != "x86_64", reason="of glibc on x86-64")
def test_runs_have_the_same_bits_without_the_instructions_of_newer_processors(tmp_path):
    """In a process whose C library and NumPy round otherwise, which is shown, too."""
    code = "import test_everywhere as t; print(*t.digests(), t.sine_of_numpy_and_c())"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    said = [
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", code],
            env=environment | lacking,
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split()
        for lacking in ({}, LACKING)
    ]
    (*usual, here), (*without, there) = said
    assert dict(zip(RUNS, usual, strict=True)) == dict(zip(RUNS, without, strict=True))
    if here == there:
        pytest.skip("the C library and NumPy of this machine round alike in both; the runs were equal")


PROGRAM = r"""
#include <stddef.h>
#include <stdint.h>
#include "plant.h"
int64_t uvms_mj_free_steps(int64_t, int64_t, int64_t);
extern const unsigned char uvms_mj_image[];
static double run[NUMBERS] __attribute__((aligned(64)));
void *memcpy(void *to, const void *from, size_t n) {
  for (size_t k = 0; k < n; k++) ((volatile char *)to)[k] = ((const char *)from)[k];
  return to;
}
void *memmove(void *to, const void *from, size_t n) {
  if (to < from) return memcpy(to, from, n);
  while (n--) ((volatile char *)to)[n] = ((const char *)from)[n];
  return to;
}
void *memset(void *to, int value, size_t n) {
  for (size_t k = 0; k < n; k++) ((volatile char *)to)[k] = value;
  return to;
}
static long call(long number, long a, long b, long c) {
  register long x8 __asm__("x8") = number, x0 __asm__("x0") = a, x1 __asm__("x1") = b, x2 __asm__("x2") = c;
  __asm__ volatile("svc 0" : "+r"(x0) : "r"(x8), "r"(x1), "r"(x2) : "memory");
  return x0;
}
void _start(void) {
  memcpy(run, uvms_mj_image, IMAGE_BYTES);
  for (int k = 0; k < TABLES; k++) run[tables[k].place] = tables[k].value;
  ((int64_t *)run)[ADDRESS] = (int64_t)(intptr_t)run;
  for (int k = 0; k < ROWS; k++) {
    uvms_mj_free_steps((int64_t)(intptr_t)run, EVERY, 1);
    call(64, 1, (long)(run + STATE), 8 * SIZE); /* write */
  }
  call(93, 0, 0, 0); /* exit */
}
"""
"""It has no C library."""
ROWS, EVERY = 200, 100


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("qemu-aarch64") is None, reason="qemu-aarch64 (package qemu-user) is not installed")
def test_the_closed_loop_on_aarch64_is_the_native_run(tmp_path):
    """20,000 steps with sines, a disturbance that is random, and the touch: a static program in an emulator."""
    pytest.importorskip("ziglang", reason="the extra docs, which has the compiler, is not installed")
    with Simulation(Scenario.load("push_wall_gusts", NEAR), engine="free_body", looks=False) as run:
        parts, memory = _Parts(run, run.scenario), run._memory
        code = loop_for(replace(AARCH64, reloc="pic"), memory.shape, list(run._stages.running))
        plant = memory.run["plant"]
        state, end = (memory.image.place(plant[name]) for name in ("qpos", "qvel"))
        end += plant["qvel"].size
        sizes = {"ROWS": ROWS, "EVERY": EVERY, "STATE": state, "SIZE": end - state}
        header = parts.header("") + "".join(f"\n#define {name} {value}" for name, value in sizes.items()) + "\n"
        (tmp_path / "plant.h").write_text(header)
        bytes_of = ",".join(map(str, parts.image))
        (tmp_path / "image.c").write_text(
            f"const unsigned char uvms_mj_image[] __attribute__((aligned(64))) = {{{bytes_of}}};\n"
        )
        (tmp_path / "main.c").write_text(PROGRAM)
        (tmp_path / "loop.o").write_bytes(code)
        there = _in_emulator(tmp_path).reshape(ROWS, -1)
        here = np.empty_like(there)
        for row in here:
            run.step(EVERY)
            row[:] = memory.image.numbers[state:end]
        assert run.signals.force_peak > 0.0
    assert here.tobytes() == there.tobytes()


def _in_emulator(folder: Path) -> np.ndarray:
    zig = [sys.executable, "-m", "ziglang"]
    options = ["-target", "aarch64-linux-musl", "-O2", "-w", "-ffreestanding", "-fno-stack-protector", "-fno-builtin"]
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": str(folder / "zig"), "ZIG_LOCAL_CACHE_DIR": str(folder / "zig")}
    for name in ("main", "image"):
        command = [*zig, "cc", *options, "-c", f"{name}.c", "-o", f"{name}.o"]
        subprocess.run(command, cwd=folder, env=environment, check=True)
    subprocess.run([*zig, "ld.lld", "-static", "main.o", "image.o", "loop.o", "-o", "run"], cwd=folder, check=True)
    done = subprocess.run(["qemu-aarch64", "./run"], cwd=folder, capture_output=True, check=True)
    return np.frombuffer(done.stdout)
