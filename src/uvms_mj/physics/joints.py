r"""Joint motors: the torque that a motor can give at its speed.

A motor gives at most its effort :math:`\hat\tau`. In the direction of motion the torque falls linearly to zero at the
speed limit :math:`\dot q_{max}`, the torque-speed line of a DC motor at a limited voltage, whose back EMF is
proportional to its speed. Against the motion, where it brakes, it gives the whole effort:

.. math::

    -\hat\tau \max(0, 1 + \min(0, \dot q) / \dot q_{max}) \le \tau \le
    \hat\tau \max(0, 1 - \max(0, \dot q) / \dot q_{max})
"""

from .kernels import kernel


@kernel
def deliverable(tau, q_dot, effort, speed_limit) -> float:
    """The torque of a motor [N m or N] for a commanded one, at the joint velocity q_dot [rad/s or m/s].

    An infinite effort or speed limit is none.
    """
    if tau * q_dot > 0.0:
        effort *= max(0.0, 1.0 - abs(q_dot) / speed_limit)
    return min(effort, max(-effort, tau))
