"""docs/evidence/benchmarks.md, from FOLDER/benchmark.json of ``scripts/benchmark.py --json``: its ratios."""

import json
from collections.abc import Iterator
from pathlib import Path


def numbers(folder: str) -> Iterator[tuple]:
    found = json.loads(Path(folder, "benchmark.json").read_text())

    def ratios(table: str, what: str, over: str) -> list[tuple[float, float]]:
        """The ratio in each state, with the spread that rounds of a shared machine have."""
        rows = {(row["what"], row["state"]): row[f"ratio_to_{over}"] for row in found[table]}
        return [(rows[what, state], 0.03 * rows[what, state]) for state in ("free", "contact")]

    untimed = "bare mj_step without MuJoCo's timers"
    yield "| GSTA in the loop, times bare | {} | {} |", *ratios("steps", "gsta", "bare")
    yield "| bare without MuJoCo's timers, times bare | {} | {} |", *ratios("steps", untimed, "bare")
    yield "user's file, times the shipped one | {} | {} |", *ratios("steps", "gsta from a user's file", "gsta")
    yield "engine free_body, times mujoco | {} | {} |", *ratios("steps", "gsta, free_body", "gsta")
    yield "| the whole loop as NumPy code, times ours | {} | {} |", *ratios("steps", "gsta in NumPy", "gsta")
    yield "at the tool of five joints, times bare | {} | {} |", *ratios("arm", "gsta at the tool", "bare")
    yield "| the same loop as NumPy code, times ours | {} | {} |", *ratios("arm", "gsta in NumPy", "gsta")
    water = {(row["what"], row["engine"]): row["ratio_to_drag"] for row in found["effects"]}
    yield "times the same drag of `[[drag]]` | {} |", (water["a user's drag", "free_body"], 0.03)
    yield "| a log at 1 kHz of 20 s | {} MB |", found["logs"][0]["MB"]
    memory = found["long_run"]
    yield "over the memory of 20 s | {} |", (memory["peak_MB"] / memory["peak_MB_of_20_s"], 0.01)
    yield "in MuJoCo, at 1e-4 s | {} |", (found["environments"][0]["in_mj_step"], 0.02)
