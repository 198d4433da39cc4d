"""A model that can't be attached is refused by name, in one table: the reason, and what was done to a sound model."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from twin import TwinParameters
from uvms_mj import InputError, attach
from vehicles import vehicle_xml

STILL = TwinParameters(v_c_W=(0.0, 0.0, 0.0))
SOUND = vehicle_xml(STILL)
LINK = 'name="origin"/><body name="link">{}<geom size="0.01" mass="1e-3"/></body>'


def written(*pairs):
    """The sound model with texts replaced, each of which it has."""

    def change():
        xml = SOUND
        for before, after in pairs:
            assert before in xml
            xml = xml.replace(before, after, 1)
        return mujoco.MjModel.from_xml_string(xml)

    return change


def numeric(name):
    return written(("</custom>", f'<numeric name="{name}" data="1"/></custom>'))


def motor(attributes):
    return written(("<motor ", f"<motor {attributes} "))


def option(name, value):
    def change():
        model = mujoco.MjModel.from_xml_string(SOUND)
        setattr(model.opt, name, value)
        return model

    return change


def entry(name, index, value):
    def change():
        model = mujoco.MjModel.from_xml_string(SOUND)
        getattr(model, name)[index] = value
        return model

    return change


def symmetric():
    """A body whose inertia is diagonal at B."""
    xml = vehicle_xml(replace(STILL, r_g=(0.0, 0.0, 0.0))).replace('simple="false"', "")
    return mujoco.MjModel.from_xml_string(xml)


REFUSED = [
    # coefficients
    ("X_u: no such <numeric>", written(('name="X_u"', 'name="X_uu_"'))),
    ("X_uu: 18.18 is not dissipative", written(('"X_uu" size="1" data="-18.18"', '"X_uu" size="1" data="18.18"'))),
    ("M_A", written(('size="36" data="5.5 ', 'size="35" data="'))),
    ("displaced_mass", written(('name="displaced_mass" size="1" data="', 'name="displaced_mass" size="1" data="-'))),
    ("centre_of_buoyancy: is not a coefficient; did you mean 'center_of_buoyancy'", numeric("centre_of_buoyancy")),
    ("Displaced_Mass: is not a coefficient; did you mean 'displaced_mass'", numeric("Displaced_Mass")),
    ("X_uuu: is not a coefficient; did you mean 'X_uu'", numeric("X_uuu")),
    # links: one without coefficients would be dry
    *(
        (
            "body 'link': moves on a joint and has no coefficient",
            written(('name="origin"/>', LINK.format(f'<joint type="{joint}"/>'))),
        )
        for joint in ("hinge", "slide")
    ),
    # thrusters: a motor on the free joint pushes along W, which is right at the reference attitude only
    (
        "m0: its wrench in B depends on the pose",
        written(
            ('<motor name="m0" site="origin"', '<motor name="m0" joint="free"'),
            ('simple="false"><freejoint/>', 'simple="false"><freejoint name="free"/>'),
        ),
    ),
    ("m0: is not a plain <motor>", motor('delay="0.01" nsample="20"')),
    ("m0: ctrlrange 5 -5: the lower limit must come first", motor('ctrlrange="5 -5"')),
    ("m0: its ctrlrange and forcerange do not overlap", motor('ctrlrange="-5 -4" forcerange="1 2"')),
    ("m0: forcerange 5 -5: the lower limit must come first", motor('forcerange="5 -5"')),
    ("m3: its site, gear or gain is not finite", entry("actuator_gear", (3, 1), np.nan)),
    # inertia
    ("M_RB: mass or inertia is not finite", entry("body_mass", 1, np.inf)),
    ("gravcomp", entry("body_gravcomp", 1, np.nan)),
    ('simple="false"', symmetric),  # which leaves no room for the added mass
    # what would lose the water
    ("PGS", option("solver", mujoco.mjtSolver.mjSOL_PGS)),
    ("noslip", option("noslip_iterations", 3)),
    ("integrator", option("integrator", 4)),
    ("sleep", option("enableflags", int(mujoco.mjtEnableBit.mjENBL_SLEEP))),
    ("diagexact", option("enableflags", int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT))),
    ("actuation", option("disableflags", int(mujoco.mjtDisableBit.mjDSBL_ACTUATION))),
    ("disable gravity: takes the weight", option("disableflags", int(mujoco.mjtDisableBit.mjDSBL_GRAVITY))),
    ("enable fwdinv", option("enableflags", int(mujoco.mjtEnableBit.mjENBL_FWDINV))),
    ("joint damping", entry("dof_damping", slice(0, 6), 0.1)),
    ("joint damping", entry("dof_dampingpoly", slice(0, 6), 0.1)),
    ("joint frictionloss: is 0.1", entry("dof_frictionloss", slice(0, 6), 0.1)),
    ("joint stiffness", entry("jnt_stiffness", 0, 0.1)),
    ("density", option("density", 1000.0)),
]


@pytest.mark.parametrize(("reason", "model"), REFUSED, ids=lambda each: each if isinstance(each, str) else "")
def test_a_model_that_would_not_move_as_a_vehicle_does_is_refused_by_name(reason, model):
    made = model()
    with pytest.raises(InputError) as refused:
        attach(made, mujoco.MjData(made))
    assert reason in str(refused.value)
    assert mujoco.get_mjcb_control() is None


def test_what_is_no_coefficient_and_a_body_that_is_fixed_are_allowed():
    """A model may have numerics for other purposes, and a fixed body is a part of the rigid one."""
    for name in ("max_contact_points", "K_gain", "another/centre_of_buoyancy"):
        model = numeric(name)()
        attach(model, mujoco.MjData(model)).detach()
    fixed = written(('name="origin"/>', LINK.format("")))()
    with attach(fixed, mujoco.MjData(fixed)) as attachment:
        assert attachment.vehicle.mass == pytest.approx(STILL.mass + 1e-3)


def test_a_body_with_a_slash_and_coefficients_without_one_is_refused_in_one_sentence():
    """It is read as a part of an attached model, whose coefficients have its prefix; those of another do not count."""
    model = written(('<body name="rov"', '<body name="rov/base_link"'))()
    with pytest.raises(InputError, match="Name the body 'rov_base_link'") as refused:
        attach(model, mujoco.MjData(model))
    assert len(refused.value.faults) == 1
