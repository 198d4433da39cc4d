"""A shape and an effect are added to a copy of the package as "Where to add something" says, and run there."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import uvms_mj

ROOT = Path(uvms_mj.__file__).parents[2]
MOST_FILES = 3
"""A shape or an effect is added in at most so many files of src."""


def shape(name: str) -> dict:
    """The entry of a ring about z: its radius, and the radius of its tube."""
    entry = (
        f'    "{name}": Shape(\n'
        '        ("radius", "length"), lambda r, length: (r, 0.5 * length, 0.0), lambda e: e[1],\n'
        '        lambda e: ("cylinder", (e[0], e[1], 0.0)),\n'
        "    ),\n"
    )
    numbers = (", CAPSULE = range(", f", {name.upper()}, CAPSULE = range(")
    return {"physics/surfaces.py": [('    "capsule": Shape(', entry + '    "capsule": Shape('), numbers]}


TORUS, HOOP = shape("torus"), shape("hoop")
ITS_LINES = {
    "physics/surfaces.py": [
        (
            "    else:  # a shape without a line here",
            "    elif surface.kind == TORUS:\n"
            "        across = math.sqrt(q[0] * q[0] + q[1] * q[1])\n"
            "        q[0] -= surface.extent[0] * q[0] / across\n"
            "        q[1] -= surface.extent[0] * q[1] / across\n"
            "        distance = normalise(q) - surface.extent[1]\n"
            "    else:  # a shape without a line here",
        )
    ]
}
KEEL = {
    "physics/effects.py": [
        ('    "drag": DRAG,\n', '    "drag": DRAG,\n    "keel": KEEL,\n'),
        ("PRODUCT = np.dtype(", 'KEEL = np.dtype([("c", "f8"), ("x", "f8")], align=True)\nPRODUCT = np.dtype('),
        (
            "    for k in range(effects.products.shape[0]):",
            "    for k in range(effects.keel.shape[0]):\n"
            "        add_keel(effects.keel[k], nu_r, tau)\n"
            "    for k in range(effects.products.shape[0]):",
        ),
        (
            "@kernel\ndef add_product(",
            "@kernel\ndef add_keel(keel, nu_r, tau):\n"
            "    v = nu_r[1] + keel.x * nu_r[5]\n"
            "    f = -keel.c * abs(v) * v\n"
            "    tau[1] += f\n"
            "    tau[5] += keel.x * f\n\n\n"
            "@kernel\ndef add_product(",
        ),
    ],
    "plant/water.py": [
        (
            "EFFECT_TABLES: dict",
            "@dataclass(frozen=True, config=STRICT)\n"
            "class Keel(EffectTable):\n"
            "    of_world: ClassVar[bool] = False\n"
            '    c: _Coefficient = doc("drag over the square of the velocity across [N s^2/m^2]", 0.0)\n'
            '    x: float = doc("place [m]", 0.0)\n\n'
            "    def records(self, situation: Situation) -> list[tuple]:\n"
            "        return [(self.c, self.x)] if self.c > 0.0 else []\n\n\n"
            "EFFECT_TABLES: dict",
        ),
        ('    "drag": Drag,\n', '    "drag": Drag,\n    "keel": Keel,\n'),
    ],
    "scenario.py": [
        ("Drag, Fin, NearWall, Pad", "Drag, Fin, Keel, NearWall, Pad"),
        ("    tether: Tether = Tether()\n", "    tether: Tether = Tether()\n    keel: Keel = Keel()\n"),
    ],
}
ROTOR = {
    "physics/effects.py": [
        ('    "drag": DRAG,\n', '    "drag": DRAG,\n    "rotor": ROTOR,\n'),
        ("PRODUCT = np.dtype(", 'ROTOR = np.dtype([("c", "f8"), ("lag", "f8")], align=True)\nPRODUCT = np.dtype('),
        ('    "fins": lambda nodes: "f8",\n', '    "rotor": lambda nodes: "f8",\n    "fins": lambda nodes: "f8",\n'),
        (
            "    for k in range(effects.products.shape[0]):",
            "    for k in range(effects.rotor.shape[0]):\n"
            "        tau[0] -= effects.rotor[k].c * abs(effects.rotor_state[k]) * effects.rotor_state[k]\n"
            "    for k in range(effects.products.shape[0]):",
        ),
        (
            "            effects.fins_state[k] = deflected(",
            "            pass\n"
            "    for k in range(effects.rotor.shape[0]):\n"
            "        effects.rotor_state[k] += h / effects.rotor[k].lag * (nu_r[0] - effects.rotor_state[k])\n"
            "    for k in range(effects.fins.shape[0]):\n"
            "        if effects.fins[k].limit > 0.0:\n"
            "            effects.fins_state[k] = deflected(",
        ),
    ],
    "plant/water.py": [
        (
            "EFFECT_TABLES: dict",
            "@dataclass(frozen=True, config=STRICT)\n"
            "class Rotor(EffectTable):\n"
            "    of_world: ClassVar[bool] = False\n"
            '    c: _OneDrag = doc("drag over the square of the inflow [N s^2/m^2]", 0.0)\n'
            '    lag: float = doc("of the inflow [s]", 0.5)\n\n'
            "    def records(self, situation: Situation) -> list[tuple]:\n"
            "        return [(self.c, self.lag)] if self.c > 0.0 else []\n\n\n"
            "EFFECT_TABLES: dict",
        ),
        ('    "drag": Drag,\n', '    "drag": Drag,\n    "rotor": Rotor,\n'),
    ],
    "scenario.py": [
        ("NearWall, Pad\n", "NearWall, Pad, Rotor\n"),
        ("    tether: Tether = Tether()\n", "    tether: Tether = Tether()\n    rotor: Rotor = Rotor()\n"),
    ],
}
RUN = """
import json, sys
from uvms_mj import Scenario, simulate
found = []
for changes, engine in json.loads(sys.argv[1]):
    try:
        trace = simulate(Scenario.load("push_wall", changes, "impedance"), engine=engine)
    except Exception as error:
        found.append(str(error))
        continue
    at_rest = getattr(trace.analytic, "reason", None) or [trace.analytic.force, *trace.analytic.position]
    p_WB, nu, push = (getattr(trace, name)[-1].tolist() for name in ("p_WB", "nu", "push"))
    found.append({"p_WB": p_WB, "nu": nu, "push": push, "rest": at_rest})
    found[-1] |= {"x": [trace.nu[:20, 0].tolist(), trace.tau_dist[:20, 0].tolist()]}
print(json.dumps(found))
"""


def run_with(folder: Path, runs: dict[str, tuple[dict, str]], additions: list[list[dict]]) -> dict:
    """What runs (changes, engine) give in a copy of the package with the texts of all additions replaced."""
    shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("models", "examples"):
        (folder / name).symlink_to(ROOT / name)
    for edits in additions:
        assert len({name for each in edits for name in each}) <= MOST_FILES
        for name, texts in (item for each in edits for item in each.items()):
            file = folder / "src" / "uvms_mj" / name
            text = file.read_text()
            for old, new in texts:
                assert text.count(old) == 1, (name, old)
                text = text.replace(old, new)
            file.write_text(text)
    own = {"PYTHONPATH": str(folder / "src"), "UVMS_MJ_CACHE_DIR": str(folder / "cache"), "PYTHONWARNINGS": "ignore"}
    (folder / "run.py").write_text(RUN)
    command = [sys.executable, "run.py", json.dumps([*runs.values()])]
    done = subprocess.run(command, cwd=folder, env=os.environ | own, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(zip(runs, json.loads(done.stdout), strict=True))


RING = {"shape": "torus", "radius": 0.6, "length": 0.4, "position": [1.0, 0.0, 0.0], "stiffness": 2e3, "damping": 200.0}
INTO_THE_RING = {
    "simulation.timestep": 1e-3,
    "simulation.duration": 20.0,
    "wall.present": False,
    "current.speed": 0.0,
    "vehicle.contact_bodies": [{"position": [0.1, 0.0, 0.0], "radius": 0.05}],
    "walls": [RING],
    "reference.target": [0.3, 0.0, 0.0],
}
INTO_THE_HOOP = INTO_THE_RING | {"walls": [RING | {"shape": "hoop"}]}
NOTHING = 1e-30
"""The coefficient of an effect that is there and does nothing, so that all runs of a law are of one compiled shape."""


def in_a_current(keel: float, drag: float) -> dict:
    of_drag = [{"forward": [0.0, drag, 0.0], "position": [0.2, 0.0, 0.0]}]
    current = {"simulation.timestep": 1e-3, "simulation.duration": 20.0, "current.direction_deg": 70.0}
    return current | {"keel.c": keel, "keel.x": 0.2, "drag": of_drag}


SLOWED = {
    "simulation.timestep": 1e-3,
    "simulation.duration": 0.03,
    "current.speed": 0.0,
    "rotor.c": 60.0,
    "rotor.lag": 0.05,
    "initial.velocity": [0.5, 0.0, 0.0, 0.0, 0.0, 0.0],
}


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """All runs, in one copy that has all additions: they do not disturb each other."""
    runs = {
        "ring": (INTO_THE_RING, "free_body"),
        "ring, whole": (INTO_THE_RING, "mujoco"),
        "hoop": (INTO_THE_HOOP, "free_body"),
        "keel": (in_a_current(60.0, NOTHING), "free_body"),
        "keel, whole": (in_a_current(60.0, NOTHING), "mujoco"),
        "drag": (in_a_current(NOTHING, 60.0), "free_body"),
        "neither": (in_a_current(NOTHING, NOTHING), "free_body"),
        "rotor": (SLOWED, "free_body"),
        "rotor, whole": (SLOWED, "mujoco"),
    }
    return run_with(tmp_path_factory.mktemp("copy"), runs, [[TORUS, ITS_LINES], [HOOP], [KEEL], [ROTOR]])


def test_a_shape_is_an_entry_and_its_lines(found):
    """A ring whose tube is 0.2 m thick: both engines press on its outside with the force of its closed form."""
    free, whole = found["ring"], found["ring, whole"]
    np.testing.assert_allclose(free["p_WB"], whole["p_WB"], rtol=0.0, atol=1e-9)
    depth = free["p_WB"][0] + 0.1 + 0.05 - (1.0 - 0.6 - 0.2)
    assert free["push"] == pytest.approx(2e3 * depth, rel=1e-6)
    assert free["push"] > 1.0
    assert free["rest"][0] == pytest.approx(free["push"], rel=1e-5)


def test_a_shape_without_its_lines_is_refused_and_is_not_a_sphere(found):
    assert found["hoop"] == "scenario: walls[0].shape: the distance from a hoop is not computed"


def test_an_effect_of_the_water_is_a_record_a_kernel_and_a_table(found):
    """It is the shipped drag at a place with the same numbers, in both engines and in the closed form."""
    for own in (found["keel"], found["keel, whole"]):
        for name in ("p_WB", "nu", "rest"):
            np.testing.assert_allclose(own[name], found["drag"][name], rtol=0.0, atol=1e-10)
        assert np.abs(np.subtract(own["p_WB"], found["neither"]["p_WB"])).max() > 1e-4
        np.testing.assert_allclose(own["p_WB"], own["rest"][1:], rtol=0.0, atol=1e-5)


def test_an_effect_with_a_state_is_the_same_and_a_line_that_advances_it(found):
    """An inflow that lags behind the velocity in the water: its drag follows from the velocities of the run. Nothing
    says that its state advances, and no closed form takes it for constant."""
    both = found["rotor"], found["rotor, whole"]
    for run in both:
        velocity, force = np.array(run["x"])
        inflow = np.zeros(len(velocity))
        for k in range(len(velocity) - 1):
            inflow[k + 1] = inflow[k] + 1e-3 / 0.05 * (velocity[k] - inflow[k])
        np.testing.assert_allclose(force, -60.0 * inflow**2, rtol=1e-12, atol=1e-15)
        assert force[-1] < -1.0
        assert run["rest"] == "closed forms do not know where rotor moves"
    np.testing.assert_allclose(both[0]["nu"], both[1]["nu"], rtol=0.0, atol=1e-9)
    assert isinstance(found["neither"]["rest"], list)
