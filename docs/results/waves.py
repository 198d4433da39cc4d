"""
In waves at a pile
==================

A BlueROV2 Heavy presses with 20 N on a pile, in a current and in irregular waves of 0.5 m. Under impedance control it
leaves the pile and hits it again. Generalised super-twisting holds the sum of both normal forces at 22 N.
``uvms-mj study waves`` maps four laws over height and period of the waves.
"""

from uvms_mj import Scenario, simulate, still

sea = {
    "vehicle.model": "bluerov2_heavy",
    "initial.position": [1.03, 0.0, 0.0],
    "reference.target": [1.042, 0.0, 0.0],
    "reference.step_time": 0.0,
    "impedance.F_d": [-20.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    "sea.height": 0.5,
    "sea.period": 5.0,
    "sea.spectrum": "jonswap",
    "sea.surface": 3.0,
}
# the waves' push changes by up to 6.3 rad/s^3: GSTA rejects what is slower than k_2/2
held = simulate(Scenario.load("press_pile", sea | {"controller.k_2": 15.0}, "gsta"))
bounced = simulate(Scenario.load("press_pile", sea, "impedance"))
scene = still(held, plots=(), size=(1280, 720))
force_figure = held.plot("force", width=6.5)
bounced_figure = bounced.plot("force", width=6.5)
