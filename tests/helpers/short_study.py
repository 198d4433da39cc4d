"""A study of short runs that touch the wall, and an executor that needs no process of its own."""

from concurrent.futures import ThreadPoolExecutor

HERE = ThreadPoolExecutor(1)

STUDY = """
[base]
scenario = "push_wall"
simulation.duration = 0.06
simulation.timestep = 2e-4
initial.position = [0.995, 0.0, 0.0]
initial.velocity = [0.2, 0.0, 0.0, 0.0, 0.0, 0.0]
[run]
engine = "{engine}"
{run}
[design]
runs = {runs}
seed = 7
[keep]
metrics = ["contact.peak_N", "contact.touches", "contact.settled", "final.position_m"{metrics}]
{keep}
[[laws]]
name = "gsta"
[[laws]]
name = "impedance"
[[vary]]
key = "wall.stiffness"
distribution = "loguniform"
low = 2e4
high = 2e5
{more}
"""


def study_text(runs=4, engine="free_body", metrics="", keep="", run="", more=""):
    """The text of a study file with these lines in it."""
    return STUDY.format(runs=runs, engine=engine, metrics=metrics, keep=keep, run=run, more=more)
