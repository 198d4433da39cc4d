"""A tuning whose optimum is known: the stiffness K_d of the impedance law, which decides the force at rest.

At rest the vehicle presses with F = (x_d - x_c) / (1 / K_d + 1 / k_c).
"""

X_D, X_C, K_C = 1.05, 1.0, 1e5

TUNING = """
[base]
scenario = "push_wall"
controller.name = "impedance"
simulation.duration = {duration}
simulation.timestep = 5e-4
current.speed = 0.0
initial.position = [1.0, 0.0, 0.0]
reference.target = [1.05, 0.0, 0.0]
reference.start = [1.05, 0.0, 0.0]
[design]
runs = {runs}
seed = 7
[run]
engine = "{engine}"
[[vary]]
key = "vehicle.added_mass"
distribution = "uniform"
low = 0.9
high = 1.1
[[gain]]
key = "impedance.K_d[0]"
low = 50.0
high = 400.0
log = true
[objective]
metric = "contact.final_N"
over = "mean"
{constraint}
[tune]
trials = {trials}
seed = 1
{more}
"""


def stiffness_for(force: float) -> float:
    """K_d [N/m] at which the vehicle presses with a force [N] at rest."""
    return 1.0 / ((X_D - X_C) / force - 1.0 / K_C)


def force_at(K_d: float) -> float:
    """The force [N] at rest with K_d [N/m]."""
    return (X_D - X_C) / (1.0 / K_d + 1.0 / K_C)


def tuning_text(trials=12, runs=2, duration=4.0, engine="free_body", constraint="", more=""):
    """The text of a tuning file with these lines in it."""
    return TUNING.format(trials=trials, runs=runs, duration=duration, engine=engine, constraint=constraint, more=more)
