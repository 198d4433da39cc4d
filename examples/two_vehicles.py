"""Two vehicles in a model of your own, both in the same water: no scenario and no law.

python examples/two_vehicles.py
"""

import mujoco

from uvms_mj import Current, attach
from uvms_mj.files import shipped

CURRENT_W = (0.2, 0.1, 0.0)
VEHICLES = {"bluerov2_heavy": 0.5, "lauv": -0.5}  # y at the start [m]


def world() -> mujoco.MjModel:
    """A model with both vehicles. The prefix keeps their names apart, the names of their coefficients, too."""
    spec = mujoco.MjSpec()
    for name, y in VEHICLES.items():
        vehicle = mujoco.MjSpec.from_file(str(shipped("models")[name]))
        vehicle.option.timestep, vehicle.option.cone = spec.option.timestep, spec.option.cone
        spec.attach(vehicle, prefix=f"{name}/", frame=spec.worldbody.add_frame(pos=[0.0, y, 0.0]))
    return spec.compile()


def drift(seconds: float) -> mujoco.MjData:
    """The vehicles after a time in a current, with their thrusters off."""
    model = world()
    data = mujoco.MjData(model)
    with (
        attach(model, data, "bluerov2_heavy/bluerov2_heavy", current=Current.of(CURRENT_W)),
        attach(model, data, "lauv/lauv", current=Current.of(CURRENT_W)),
    ):
        mujoco.mj_step(model, data, round(seconds / model.opt.timestep))
    return data


if __name__ == "__main__":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.0), layout="constrained")
    axes = figure.subplots()
    places = [drift(t) for t in (5.0, 10.0, 15.0, 20.0)]
    for name, y in VEHICLES.items():
        path = [(0.0, y), *(data.body(f"{name}/{name}").xpos[:2] for data in places)]
        axes.plot(*zip(*path, strict=True), "o-", label=f"{name}, every 5 s")
        print(name, path[-1])
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.legend()
