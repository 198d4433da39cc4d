"""One vehicle in five formats: an SDF of gz-sim, a URDF of the UUV Simulator, and tables in two sets of axes.

Its numbers are in B: forward, left, up, about the origin. It is no real vehicle, and has the structure of real files.
"""

from pathlib import Path

import numpy as np
import pytest

from uvms_mj.plant.importing import imported
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.record import VehicleRecord, mjcf_text
from uvms_mj.plant.vehicle import Vehicle

NED = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
MASS, R_G, R_B = 21.0, np.array([0.02, -0.01, -0.03]), np.array([0.01, 0.005, 0.02])
EDGES = (0.6, 0.4, 0.1)
DENSITY = 1025.0
DISPLACED = DENSITY * 0.6 * 0.4 * 0.1
INERTIA = np.array([[0.5, 0.02, -0.03], [0.02, 0.9, 0.01], [-0.03, 0.01, 1.1]])
M_A = np.diag([6.0, 14.0, 19.0, 0.2, 0.3, 0.4])
M_A[0, 4] = M_A[4, 0] = -0.5
M_A[1, 5] = M_A[5, 1] = 0.7
M_A[1, 3] = M_A[3, 1] = 0.4
D_LINEAR = np.diag([5.0, 9.0, 11.0, 0.3, 0.4, 0.5])
D_LINEAR[1, 5], D_LINEAR[5, 1], D_LINEAR[2, 4] = 0.6, -0.2, 0.35
D_QUADRATIC = np.diag([60.0, 90.0, 120.0, 1.0, 1.2, 1.5])
PRODUCTS = {"Yur": -2.5, "Nuv": 1.75, "Mu|q|": -0.5, "Zpv": 0.25}
"""The coefficient of u r on Y, ... in B."""
THRUSTERS = {
    "port": ((-0.25, 0.2, 0.0), (1.0, 0.0, 0.0), (-40.0, 50.0)),
    "starboard": ((-0.25, -0.2, 0.0), (1.0, 0.0, 0.0), (-40.0, 50.0)),
    "vertical": ((0.1, 0.0, 0.05), (0.0, 0.0, 1.0), (-30.0, 35.0)),
    "lateral": ((0.2, 0.0, -0.02), (0.6, 0.8, 0.0), (-20.0, 20.0)),
}


def rpy_of(direction: tuple[float, float, float], axis: str) -> str:
    """Roll, pitch, yaw of a frame whose x or z axis has a direction, as URDF and SDF mean them."""
    x, y, z = direction
    yaw, level = np.arctan2(y, x) if x or y else 0.0, np.hypot(x, y)
    pitch = np.arctan2(-z, level) if axis == "x" else np.arctan2(level, z)
    return f"0 {float(pitch)!r} {float(yaw)!r}"


def words(values: np.ndarray | tuple) -> str:
    return " ".join(repr(float(x)) for x in np.ravel(values))


def inertia_elements() -> str:
    names = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
    return "".join(f"<{name}>{float(INERTIA[i, j])!r}</{name}>" for name, (i, j) in names.items())


def gz_terms() -> str:
    """The coefficients as gz-sim's derivatives."""
    rows, columns = "xyzkmn", "UVWPQR"
    found = [
        f"<{rows[i]}Dot{columns[j]}>{-float(M_A[i, j])!r}</{rows[i]}Dot{columns[j]}>"
        f"<{rows[i]}{columns[j]}>{-float(D_LINEAR[i, j])!r}</{rows[i]}{columns[j]}>"
        for i in range(6)
        for j in range(6)
    ]
    found += [f"<{rows[i]}{c}abs{c}>{-float(D_QUADRATIC[i, i])!r}</{rows[i]}{c}abs{c}>" for i, c in enumerate(columns)]
    for name, c in PRODUCTS.items():
        tag = f"{name[0].lower()}{name.replace('|', 'abs', 1).replace('|', '')[1:]}"
        tag = (
            tag[0]
            + "".join(each.upper() if each in "uvwpqr" else each for each in tag[1:].split("abs")[0])
            + (f"abs{tag.split('abs')[1].upper()}" if "abs" in tag else "")
        )
        found.append(f"<{tag}>{c!r}</{tag}>")
    return "\n".join(found)


def sdf(body: str = "", plugins: str = "", world: bool = True) -> str:
    """The vehicle as SDF, with more links and joints in its model, and more plugins. Its links are placed in a model
    that is turned against the world, which must not matter."""
    links, joints, thrusters = "", "", ""
    for name, (place, direction, (low, high)) in THRUSTERS.items():
        links += f"""<link name="{name}"><pose>{words(place)} {rpy_of(direction, "z")}</pose></link>"""
        joints += f"""<joint name="{name}_joint" type="revolute"><parent>hull</parent><child>{name}</child>
            <axis><xyz>0 0 1</xyz></axis></joint>"""
        thrusters += f"""<plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">
            <joint_name>{name}_joint</joint_name><max_thrust_cmd>{high}</max_thrust_cmd>
            <min_thrust_cmd>{low}</min_thrust_cmd></plugin>"""
    x, y, z = R_B
    model = f"""<model name="fish"><pose>1 2 -3 0.1 0.2 0.3</pose>
      <link name="hull"><inertial><pose>{words(R_G)} 0 0 0</pose><mass>{MASS}</mass>
          <inertia>{inertia_elements()}</inertia></inertial>
        <collision name="volume"><pose>{x} {y} {z} 0 0 0</pose><geometry><box><size>{words(EDGES)}</size></box>
          </geometry></collision></link>{links}{joints}{body}
      <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
        <link_name>hull</link_name>{gz_terms()}</plugin>{thrusters}{plugins}</model>"""
    buoyancy = f"""<plugin filename="gz-sim-buoyancy-system" name="gz::sim::systems::Buoyancy">
        <uniform_fluid_density>{DENSITY}</uniform_fluid_density></plugin>"""
    return f'<sdf version="1.9"><world name="sea">{buoyancy}{model}</world></sdf>' if world else f"<sdf>{model}</sdf>"


def urdf(more: str = "", hydro: str = "", water: str = "") -> str:
    """The vehicle as URDF of the UUV Simulator, whose coefficients are in x forward, y right, z down, without products;
    with more links, more of the hydrodynamic model, and the water of more links."""
    parts = ""
    for i, (name, (place, direction, (low, high))) in enumerate(THRUSTERS.items()):
        parts += f"""<link name="fish/{name}"/><joint name="fish/{name}_joint" type="continuous">
            <origin xyz="{words(place)}" rpy="{rpy_of(direction, "x")}"/><axis xyz="1 0 0"/>
            <parent link="fish/base_link"/><child link="fish/{name}"/></joint>
            <gazebo><plugin name="t{i}" filename="libuuv_thruster_ros_plugin.so"><linkName>fish/{name}</linkName>
            <jointName>fish/{name}_joint</jointName><thrusterID>{i}</thrusterID>
            <thrustMin>{low}</thrustMin><thrustMax>{high}</thrustMax></plugin></gazebo>"""
    xx, yy, zz, xy, xz, yz = (float(INERTIA[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    mirrored = [NED[:, None] * M * NED for M in (M_A, -D_LINEAR, -D_QUADRATIC)]
    return f"""<robot name="fish"><link name="fish/base_link"><inertial><mass value="{MASS}"/>
        <origin xyz="{words(R_G)}"/>
        <inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="{xz}" iyz="{yz}"/></inertial></link>{parts}{more}
      <gazebo><plugin name="uuv" filename="libuuv_underwater_object_ros_plugin.so">
        <fluid_density>{DENSITY}</fluid_density><link name="fish/base_link">
          <volume>{float(np.prod(EDGES))!r}</volume><center_of_buoyancy>{words(R_B)}</center_of_buoyancy>
          <hydrodynamic_model><type>fossen</type><added_mass>{words(mirrored[0])}</added_mass>
            <linear_damping>{words(mirrored[1])}</linear_damping>
            <quadratic_damping>{words(np.diag(mirrored[2]))}</quadratic_damping>{hydro}</hydrodynamic_model>
        </link>{water}</plugin></gazebo></robot>"""


def table(frame: str, signs: str, products: dict[str, float], integral: bool = False) -> str:
    """The vehicle as a table in TOML, in one of two sets of axes and of signs."""
    f = NED if frame == "ned" else np.ones(6)
    s = -1.0 if signs == "derivatives" else 1.0
    matrices = {"added_mass": M_A, "linear_damping": D_LINEAR, "quadratic_damping": D_QUADRATIC}
    rows = {key: (s * f[:, None] * M * f + 0.0).tolist() for key, M in matrices.items()}
    inertia = f[:3, None] * INERTIA * f[:3]
    off = -1.0 if integral else 1.0
    six = [*np.diag(inertia), off * inertia[0, 1], off * inertia[0, 2], off * inertia[1, 2]]
    terms = {
        name: c * np.prod([f["XYZKMN".index(name[0])], *(f["uvwpqr".index(v)] for v in unbarred(name))])
        for name, c in products.items()
    }
    text = f"""
name = "fish"
frame = "{frame}"
about = "origin"
signs = "{signs}"
[body]
mass = {MASS}
displaced_mass = {DISPLACED!r}
cg = {(f[:3] * R_G).tolist()}
cb = {(f[:3] * R_B).tolist()}
inertia = {[float(x) for x in six]}
products_of_inertia = "{"integral" if integral else "matrix"}"
"""
    text += "".join(f"[{key}]\nmatrix = {value}\n" for key, value in rows.items())
    text += "[products]\n" + "".join(f'"{name}" = {float(c)!r}\n' for name, c in terms.items())
    for name, (place, direction, (low, high)) in THRUSTERS.items():
        text += f"""[[thrusters]]
name = "{name}"
position = {(f[:3] * place + 0.0).tolist()}
direction = {(f[:3] * direction + 0.0).tolist()}
min = {low}
max = {high}
"""
    return text


def unbarred(name: str) -> str:
    """The velocities of a product that have a sign."""
    return name[1:].split("|")[0] if "|" in name else name[1:]


def read(folder: Path, suffix: str, text: str, **more) -> tuple[VehicleRecord, Vehicle]:
    """The record of a text in a format, and the vehicle that its MJCF is."""
    path = folder / f"source{suffix}"
    path.write_text(text)
    record = imported(path, "fish", **more)
    written = folder / "fish.xml"
    written.write_text(mjcf_text(record))
    return record, Mjcf.find(str(written)).vehicle


ARRAYS = ("M_RB", "M_A", "D_linear", "D_quadratic", "r_b", "B", "u_min", "u_max")


def terms(vehicle):
    return {each.term: each.coefficient for each in vehicle.products}


def same(one, other, but=()):
    """Whether two vehicles have the same numbers to 1e-12 of their greatest."""
    for name in ARRAYS:
        if name not in but:
            a, b = getattr(one, name), getattr(other, name)
            np.testing.assert_allclose(
                a, b, rtol=0.0, atol=1e-12 * max(1.0, np.abs(a[np.isfinite(a)]).max()), err_msg=name
            )
    assert one.displaced_mass == pytest.approx(other.displaced_mass, rel=1e-12)
    assert terms(one) == pytest.approx(terms(other), rel=1e-12)
