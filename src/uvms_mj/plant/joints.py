"""MuJoCo's constraints of a joint: Coulomb friction of the gear with stick, and the stops of the range.

Both are rows of MuJoCo's constraint solver, which is implicit: they need no smaller time step, whatever the inertia.
With the inverse inertia w of the joint (``dof_invweight0``), the time step h, the impedance d and the time constant T
of solref:

- Friction: a joint that slips is given exactly the friction torque. A joint that sticks under the load tau creeps with
  the velocity ``(1 - d) T / 2 w tau``, because MuJoCo's friction is a stiff damper below its limit. T = 2 h is the
  least that MuJoCo allows, and d = 0.9999 the greatest. A joint that stops does so in one step. Added mass changes
  neither. Rotors of unknown inertia are often left out, and the inertia about a forearm's own axis is then so small
  that w tau is large. The constraints are therefore computed with a hundredth of w, and the velocity is
  1e-6 h w tau. With a ten-thousandth MuJoCo's solver does not always converge.
- Stops: a stop is a critically damped spring of the stiffness ``1 / (T^2 (1 - d) 0.01 w)``, whose time constant is T.
"""

import mujoco

FRICTION_IMPEDANCE = 0.9999
"""MuJoCo's greatest impedance, mjMAXIMP."""
STOP_IMPEDANCE = 0.99
STOP_TIME = 2e-3
"""Time constant of the stops [s], or two time steps, which is MuJoCo's least, if they are longer."""


HARDER = 0.01
"""Inverse inertia of a joint for its constraints, over that of its inertia."""


def set_constraints(model: mujoco.MjModel) -> None:
    """Set the solver's constants of friction and stops for all joints of a compiled model. Call it once."""
    h = model.opt.timestep
    model.dof_invweight0[:] *= HARDER
    model.dof_solref[:] = 2.0 * h, 1.0
    model.dof_solimp[:, :2] = FRICTION_IMPEDANCE
    model.jnt_solref[:] = max(STOP_TIME, 2.0 * h), 1.0
    model.jnt_solimp[:, :2] = STOP_IMPEDANCE
