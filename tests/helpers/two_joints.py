"""A vehicle with a hinge and a slide for tests of joints: a neutral base with one motor per axis, and light links."""

HINGE, SLIDE = 'type="hinge" axis="0 1 0"', 'type="slide" axis="1 0 0"'
STILL = {
    "wall.position": 50.0,
    "current.speed": 0.0,
    "reference.target": [0.0, 0.0, 0.0],
    "simulation.timestep": 2e-4,
    "simulation.duration": 0.5,
}
"""Overrides of push_wall for a vehicle that stays where it is."""


def two_joints(hinge: str = "", slide: str = "", custom: str = "", gravity: float = 9.81) -> str:
    """The MJCF. The hinge ``shoulder`` carries 2 kg at 0.3 m, the slide ``jaw`` 0.5 kg in it; ``hinge`` and ``slide``
    are further attributes of the joints, ``custom`` further numerics. The link of the shoulder is not neutral."""
    gears = [" ".join("1" if i == k else "0" for i in range(6)) for k in range(6)]
    thrusters = "".join(f'<motor site="origin" gear="{gear}"/>' for gear in gears)
    diagonal = " ".join(f"{40.0 if i == j else 0.0}" for i in range(6) for j in range(6))
    nothing = " ".join(["0"] * 36)
    return f"""<mujoco><compiler angle="radian"/><option gravity="0 0 {-gravity}"/>
    <custom>
      <numeric name="M_A" data="{diagonal}"/><numeric name="D_linear" data="{diagonal}"/>
      <numeric name="D_quadratic" data="{diagonal}"/><numeric name="displaced_mass" data="50"/>
      <numeric name="arm.displaced_mass" data="0.8"/><numeric name="arm.center_of_buoyancy" data="0.25 0 0"/>
      <numeric name="finger.displaced_mass" data="0.5"/>
      <numeric name="arm.M_A" data="{nothing}"/><numeric name="finger.M_A" data="{nothing}"/>{custom}
    </custom>
    <worldbody><body name="rov"><freejoint/><site name="origin"/>
      <inertial pos="0 0 0" mass="50" diaginertia="10 10 10"/>
      <body name="arm" pos="0.2 0 -0.1"><joint name="shoulder" {HINGE} {hinge}/>
        <inertial pos="0.3 0 0" mass="2" diaginertia="0.01 0.02 0.02"/>
        <body name="finger" pos="0.5 0 0"><joint name="jaw" {SLIDE} {slide}/>
          <inertial pos="0 0 0" mass="0.5" diaginertia="0.001 0.001 0.001"/>
          <site name="tip" pos="0.05 0 0" size="0.01"/>
        </body>
      </body>
    </body></worldbody>
    <actuator>{thrusters}
      <motor joint="shoulder" gear="2" ctrlrange="-4.5 4.5"/><motor joint="jaw" ctrlrange="-20 20"/>
    </actuator></mujoco>"""
