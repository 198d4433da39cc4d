"""Make tests/data/python_vehicle_simulator.npz: accelerations of 300 random vehicles by independent functions.

    git clone https://github.com/cybergalactic/PythonVehicleSimulator
    python scripts/reference_accelerations.py PythonVehicleSimulator/src/python_vehicle_simulator/lib/gnc.py

The functions are T. I. Fossen's: Smtrx, Hmtrx, Rzyx, m2c and gvect of gnc.py. This repository contains none of their
code. They are combined as in the vehicles of that project:

    nu_dot = M^-1 (tau - (C_RB(nu_r) + C_A(nu_r)) nu_r - D(nu_r) nu_r - g(eta)) + nu_c_dot

The frames are as in gnc.py: north, east, down, and forward, right, down. The inputs are numbers in single precision,
so that they are stored exactly. The accelerations are computed and stored in double precision.
"""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

VEHICLES, SEED, GRAVITY = 300, 2026, 9.81


def random_inputs(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A vehicle of eight point masses with full M_A and D, and its state, current and wrench, in SI units."""
    points, masses = rng.normal(size=(8, 3)) * 0.3 + rng.normal(size=3) * 0.3, rng.uniform(0.5, 2.0, 8)
    mass, r_g = masses.sum(), masses @ points / masses.sum()
    I_g = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points - r_g, strict=True))
    a = rng.normal(size=(6, 6))
    inputs = {
        "mass": mass,
        "I_g": I_g,  # about the centre of gravity
        "r_g": r_g,
        "r_b": rng.normal(size=3) * 0.1,
        "buoyancy": mass * GRAVITY * rng.uniform(0.8, 1.2),
        "M_A": 2.0 * (a @ a.T) + 0.1 * np.eye(6),
        "D_linear": np.diag(rng.uniform(5, 10, 6)) + rng.uniform(-1, 1, (6, 6)),
        "D_quadratic": np.diag(rng.uniform(10, 30, 6)) + rng.uniform(-2, 2, (6, 6)),
        "euler": rng.uniform(-1, 1, 3) * [np.pi, 1.4, np.pi],  # roll, pitch, yaw
        "nu": rng.normal(size=6),
        "v_c_n": rng.normal(size=3) * 0.5,
        "tau": rng.normal(size=6) * 20,
    }
    return {name: np.asarray(value, np.float32) for name, value in inputs.items()}


def acceleration(gnc: ModuleType, inputs: dict[str, np.ndarray]) -> np.ndarray:
    """nu_dot (6,), with the functions of gnc.py."""
    x = {name: value.astype(float) for name, value in inputs.items()}
    H = gnc.Hmtrx(x["r_g"])
    M_CG = np.block([[x["mass"] * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), x["I_g"]]])
    M_RB, M_A = H.T @ M_CG @ H, x["M_A"]
    roll, pitch, yaw = x["euler"]
    v_c = gnc.Rzyx(roll, pitch, yaw).T @ x["v_c_n"]
    nu_c_dot = np.r_[-gnc.Smtrx(x["nu"][3:]) @ v_c, np.zeros(3)]
    nu_r = x["nu"] - np.r_[v_c, np.zeros(3)]
    C = gnc.m2c(M_RB, nu_r) + gnc.m2c(M_A, nu_r)
    D = x["D_linear"] + x["D_quadratic"] * np.abs(nu_r)
    g_eta = gnc.gvect(x["mass"] * GRAVITY, x["buoyancy"], pitch, roll, x["r_g"], x["r_b"])
    return np.linalg.solve(M_RB + M_A, x["tau"] - C @ nu_r - D @ nu_r - g_eta) + nu_c_dot


def main(gnc_py: str) -> None:
    spec = importlib.util.spec_from_file_location("gnc", gnc_py)
    assert spec is not None
    assert spec.loader is not None
    gnc = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(gnc)
    rng = np.random.default_rng(SEED)
    vehicles = [random_inputs(rng) for _ in range(VEHICLES)]
    columns: dict[str, Any] = {name: np.array([each[name] for each in vehicles]) for name in vehicles[0]}
    nu_dot = np.array([acceleration(gnc, each) for each in vehicles])
    out = Path(__file__).parents[1] / "tests" / "data" / "python_vehicle_simulator.npz"
    np.savez_compressed(out, gravity=GRAVITY, nu_dot=nu_dot, **columns)
    print(f"{out}: {out.stat().st_size} bytes")


if __name__ == "__main__":
    main(sys.argv[1])
