"""Files with laws, for tests."""

HEADER = """
from dataclasses import dataclass
import numpy as np
from uvms_mj import Controller, gain
"""


def law_file(tmp_path, body, name="my_law.py", header=HEADER):
    path = tmp_path / name
    path.write_text(header + body)
    return path


def one_liner(name, body):
    lines = "\n".join(f"        {line}" for line in body.strip().splitlines())
    head = f"@dataclass(frozen=True)\nclass {name}(Controller):\n    @staticmethod\n"
    return f"{head}    def law(gains, state, signals, state_dot, tau_cmd):\n{lines}\n"
