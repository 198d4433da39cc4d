"""
Many vehicles that the law does not know
========================================

Added mass and current vary in 24 runs of 10 s in the engine free_body. A study is the same, bit for bit, for any number
of worker processes.
"""

from uvms_mj import Study

study = Study.from_dict(
    {
        "base": {"scenario": "push_wall", "simulation": {"duration": 10.0}},
        "laws": ["impedance", "fosm", "gsta"],
        "vary": [
            {"key": "vehicle.added_mass", "distribution": "uniform", "low": 0.5, "high": 1.5},
            {"key": "current.speed", "distribution": "uniform", "low": 0.0, "high": 0.6},
        ],
        "design": {"runs": 24},
        "run": {"engine": "free_body"},
        "success": {"contact.final_N": [1.35, 1.65]},
    }
)
study.run("study", workers=2)
for row in study.table():
    print("".join(f"{entry!s:12}" for entry in row))
figure = study.plot()
