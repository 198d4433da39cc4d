"""What a scenario refuses, as one table: the words of the message, settings of push_wall as text or by key, and perhaps
the law.

Parts of a message are in their order, with " … " between them. A row is refused when it is loaded or checked, and by a
reset in the same words, which changes nothing.
"""

import re

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation
from uvms_mj.files import parse_setting
from uvms_mj.navigation.channel import IN_FLIGHT
from uvms_mj.scenario import keys
from uvms_mj.setup.checks import checked


def of(name, **settings):
    """The overrides of one table, with its name."""
    table, _, name = name.partition("=")
    return {f"{table}.{key}": value for key, value in settings.items()} | ({f"{table}.name": name} if name else {})


def wall(**settings):
    return {"walls": [{"shape": "plane", "position": [1, 0, 0]} | settings]}


def weighted(*weights, name="weighted"):
    return {"actuation.name": name, "actuation.weights": list(weights)}


def curve(command, thrust):
    return of("thrusters=general", curve_command=command, curve_thrust=thrust)


def by_hand(**thrusters):
    return {"controller.name": "external", "actuation.name": "pwm"} | thrusters


ASKEW = (np.diag([20.0, 25.0, 25.0, 4.0, 4.0, 4.0]) + np.eye(6, k=1)).tolist()
ROUGH = {"wall.friction": 0.2}
NOT_TOML = "write the number alone, in the unit of the key"
REFUSED = [
    # allocation and thrusters
    ("actuation.weights: has 2 values; the vehicle has 6 thrusters", weighted(1.0, 2.0)),
    ("actuation.weights[0]: … from 0.001 to 1000", weighted(*[0.0] * 6)),
    ("actuation.weights: … has 2 values; 6 are needed", weighted(1.0, 2.0, name="constrained")),
    (
        "push_wall: actuation.weights[3]: -5.0 must be from 0.001 to 1000",
        weighted(1.0, 1.0, 1.0, -5.0, 5.0, 5.0, name="constrained"),
    ),
    ("actuation.name: pwm needs thrusters.name = t200, or general with a curve", by_hand()),
    (
        "thrusters.assumed_voltage: with actuation.name = pwm nothing is assumed",
        by_hand(**of("thrusters=t200", assumed_voltage=12.0)),
    ),
    ("thrusters.curve_command: is not a curve of pulse widths", by_hand(**curve([-1.0, 1.0], [-1.0, 1.0]))),
    ("thrusters.name: no thruster model 't300'; did you mean 't200'", of("thrusters=t300")),
    ("thrusters.period: ideal thrusters have no period", of("thrusters=ideal", period=0.01)),
    ("thrusters.voltage: … from 10 to 20 V", of("thrusters=t200", voltage=24.0)),
    ("thrusters.lag: … 'none', 'first_order' or 'third_order'", of("thrusters=t200", lag="slow")),
    ("thrusters.curve_thrust: t200 has no such setting", of("thrusters=t200", curve_thrust=[0.0, 1.0])),
    ("thrusters.failed: -1 must be at least 0", of("thrusters=general", failed=-1)),
    ("thrusters.failed: 7: the vehicle has 6 thrusters", of("thrusters=general", failed=7)),
    ("set failed_fraction or failed_stuck", of("thrusters=general", failed_stuck=True, failed_fraction=0.5)),
    ("has 1 values, and … has 2", curve([1.0, 2.0], [0.0])),
    ("has one point", curve([1.0], [0.0])),
    ("1 follows 1: … increase", curve([1.0, 1.0], [0.0, 1.0])),
    ("-1 N follows 0 N: … fall", curve([0.0, 1.0], [0.0, -1.0])),
    ("must pass through zero", curve([0.0, 1.0], [2.0, 3.0])),
    ("must pass through zero", curve([0.0, 1.0], [0.0, 0.0])),
    ("3 N twice: … at zero only", curve([0, 1, 2], [0, 3, 3])),
    # laws, task and impedance
    ("controller.limit … must not have a negative entry", {"controller.limit": [-1.0, *[1.0] * 5]}, "pid"),
    ("controller.epsilon … must not have a zero or negative entry", "controller.epsilon=0.0", "aismc"),
    ("controller.bandwidth … 6 are needed", {"controller.bandwidth": [1.0] * 5}, "dob_impedance"),
    ("controller.k_p … must be positive", "controller.k_p=0.0", "admittance"),
    ("controller.k_j … k_i", "controller.k_j=1.0", "parallel"),
    ("controller.name: 'fosm' and 'gsta' are given; choose one", {"controller.name": "fosm"}, "gsta"),
    ("controller.F_1: gsta has no such gain", "controller.F_1=2.0"),
    ("controller.K_s: gsta has no such gain; for this one choose controller.name = fosm", "controller.K_s=1.0"),
    ("controller.period: 0.00015 s is not a multiple of the time step", "controller.period=1.5e-4"),
    (
        "controller.delay: 0.0025 s is not a multiple … 0.002 and 0.003 s",
        {"controller.delay": 0.0025, "simulation.timestep": 1e-3},
    ),
    (
        "controller.delay: 1.5 s must be at most 1 s, 1000 control periods of 0.001 s",
        {"controller.delay": 1.5, "simulation.timestep": 1e-3},
    ),
    ("controller.delay: -0.001 must be from 0 to 10 s", "controller.delay=-0.001"),
    ("task.period: 0.01 must be omitted: the task runs at controller.period", "task.period=0.01"),
    ("task.F_2: … invertible", "task.F_2=0.0"),
    ("task.A: … must be 0 or omitted if integral is true", {"task.integral": True, "task.A": -50.0}),
    ("task.inertia_period: has no effect", "task.inertia_period=2e-3"),
    (
        "impedance.M_d: 'natural' changes with the posture; the law admittance needs",
        {"impedance.M_d": "natural"},
        "admittance",
    ),
    (
        "impedance.M_d: 'naturel' must be \"natural\", six numbers, a diagonal, or six rows",
        {"impedance.M_d": "naturel"},
    ),
    ("impedance.M_d: is not symmetric", {"impedance.M_d": ASKEW}),
    ("impedance.M_d: is not positive definite", {"impedance.M_d": [-1.0] * 6}),
    *(
        (f"impedance.{name}: … must have numbers from -1e+09 to 1e+09 {unit}", {f"impedance.{name}": value})
        for name, unit in (("M_d", "kg"), ("D_d", "N s/m"))
        for value in ([1e10] * 6, [[1e10] * 6] * 6, [10**400] * 6)
    ),
    (
        "impedance.schedule: … at 7 s, … ends at 8 s",
        {"impedance.schedule": [{"time": 5.0, "ramp": 3.0}, {"time": 7.0}]},
    ),
    ("impedance.schedule: … an entry at 5 s", {"impedance.schedule": [{"time": 5.0}, {"time": 5.0}]}),
    (
        "impedance.schedule[0].K_f[0]: -1.0 must be from 0",
        {"impedance.schedule": [{"time": 5.0, "K_f": [-1.0] * 6}]},
    ),
    ("impedance.schedule[0].F_d: … 6 are needed", {"impedance.schedule": [{"time": 5.0, "F_d": [1.0]}]}),
    (
        "impedance.schedule[0].Kf: no such key; did you mean 'K_f'",
        {"impedance.schedule": [{"time": 5.0, "Kf": [1.0] * 6}]},
    ),
    ("impedance.schedule[0].time: lacks this key", {"impedance.schedule": [{"K_f": [1.0] * 6}]}),
    ("impedance.schedule: … at most 100", {"impedance.schedule": [{"time": float(k)} for k in range(101)]}),
    # sensors and guidance
    (
        "navigation.imu_period: 0.005 s is not a multiple of the period of this stage, 0.002 s … "
        "navigation.dvl_period: 0.007 s is not a multiple of imu_period, 0.005 s … "
        "navigation.force_delay: 0.003 s is not a multiple of the sensors' period 0.002 s",
        of("navigation=ekf", period=0.002, dvl_period=0.007, force_delay=0.003),
    ),
    (
        "navigation.force_period: 0.00015 s is not a multiple of the sensors' period 0.0001 s; the nearest are 0.0001",
        of("navigation=sensors", force_period=0.00015),
    ),
    (
        f"navigation.velocity_delay: 2 s with the jitter is too long … at most {IN_FLIGHT - 2}",
        of("navigation=sensors", velocity_delay=2.0),
    ),
    ("navigation.force_noise: -1.0 must not be negative", of("navigation=sensors", force_noise=-1.0)),
    ("navigation.force_noise: … has 2 values; 3 are needed", of("navigation=sensors", force_noise=[1.0, 2.0])),
    ("navigation.force_dropout: 1.0 must be less than 1", of("navigation=sensors", force_dropout=1.0)),
    ("navigation.force_bais: … did you mean 'force_bias'?", of("navigation=sensors", force_bais=1.0)),
    (
        "observer.calibrate_until: 0.5 must be 0 or above calibrate_from, 1.0",
        of("observer=momentum_observer", calibrate_from=1.0, calibrate_until=0.5),
    ),
    ("no observer 'momentum'; did you mean 'momentum_observer'", of("observer=momentum")),
    ("observer.time_constant: 0", of("observer=momentum_observer", time_constant=0.0)),
    (
        "observer.threshold: none has no such setting; for this one choose observer.name = mom",
        of("observer", threshold=1),
    ),
    ("wrist.site: 'hand'", {"vehicle.model": "planar_arm", **of("wrist=sensor", site="hand")}),
    (
        "reference.name: along_wall follows [wall], and wall.present is false",
        {"reference.name": "along_wall", "wall.present": False},
    ),
    (
        "reference.name: along_wall pushes with the sphere about the origin, and the scenario has ",
        {"reference.name": "along_wall", "vehicle.contact_bodies": [{"position": [0.2, 0.0, 0.0], "radius": 0.05}]},
    ),
    # vehicle
    ("vehicle.mass: 0.0 must be from 0.001 to 1000", "vehicle.mass=0.0"),
    ("vehicle.added_mass: -0.1 must be from 0 to 1000", "vehicle.added_mass=-0.1"),
    ("vehicle.damping: no such key; did you mean", "vehicle.damping=2.0"),
    ("vehicle.thruster_offset … has 2 values; 3 are needed", {"vehicle.thruster_offset": [[0.0, 0.0]]}),
    ("vehicle.thruster_offset: has 3 offsets; 6 are needed, of", {"vehicle.thruster_offset": [[0.0] * 3] * 3}),
    ("vehicle.payloads[0].link: 'hand' is not a link or the base", {"vehicle.payloads": [{"link": "hand", "mass": 1}]}),
    ("vehicle.payloads[0].mass", {"vehicle.payloads": [{"link": "bluerov1", "mass": -1.0}]}),
    (
        "vehicle.payloads is not computed by the engine free_body",
        {"vehicle.payloads": [{"link": "bluerov1", "mass": 1.0}]},
    ),
    ("initial.joints: has 1 positions", {"initial.joints": [0.1]}),
    ("is for a vehicle with joints; bluerov1 has none", {"joints.name": "position"}),
    ("is for a vehicle with joints; bluerov1 has none", {"encoder.name": "encoder"}),
    ("encoder.period: a perfect encoder has no period", "encoder.period=1e-3"),
    ("posture: the vehicle 'bluerov1' has no joints, so the task leaves nothing", {"posture.order": ["joints"]}),
    ("vehicle.coulomb_friction: has no effect: bluerov1 has no joints", "vehicle.coulomb_friction=0.5"),
    # walls
    ("wall.stiffness: 1e+10 N/m is too stiff for a time step", {"wall.stiffness": 1e10, "wall.damping": 0.0}, "pid"),
    ("wall.damping: 1e+09 … is too much for a time step", "wall.damping=1e9"),
    ("wall.tangential_stiffness: 1e+10 N/m is too stiff", ROUGH | {"wall.tangential_stiffness": 1e10}),
    ("wall.tangential_damping: 1e+07 N s/m is too much", ROUGH | {"wall.tangential_damping": 1e7}),
    ("by default critical damping for 1e", ROUGH | {"wall.tangential_stiffness": 1e9}),
    ("walls[0].shape: 'cone' must be 'plane'", wall(shape="cone")),
    ("walls[0].position: lacks this key", {"walls": [{"shape": "plane"}]}),
    ("walls[0]: a sphere needs radius", wall(shape="sphere")),
    ("walls[0]: a plane has no radius", wall(radius=1.0)),
    ("did you mean 'stiffness'", wall(stifness=1.0)),
    ("needs frequency_hz", wall(amplitude=[1, 0, 0])),
    ("belong together", wall(layer_depth=0.1)),
    ("motion[1]: time 1", wall(motion=[[1, 0, 0, 0]] * 2)),
    ("walls[0].stiffness: the scenario has 0 [[walls]]", "walls[0].stiffness=1.0"),
    ("vehicle.contact_bodies[0].radius: lacks", {"vehicle.contact_bodies": [{"position": [0, 0, 0]}]}),
    ("bumper: damping needs stiffness", "bumper.damping=3.0"),
    (
        "vehicle.contact_bodies[0].end: contact of a capsule with a box, walls[0], is not computed … "
        "bumper.stiffness: belongs to the probe … walls[0].stiffness: 1e+10 N/m",
        wall(shape="box", position=[1.5, 0, 0], edges=[1.0, 1.0, 1.0], stiffness=1e10)
        | {"vehicle.contact_bodies": [{"position": [0.2, 0, 0], "end": [0.2, 0.1, 0], "radius": 0.05}]}
        | {"wall.present": False, "bumper.stiffness": 1e3},
    ),
    # water
    ("disturbance.frequency_hz[0] … must be below half the step rate", {"disturbance.frequency_hz": [6e3, *[0] * 5]}),
    ("frequency_hz[2] … act as 1 Hz", {"disturbance.frequency_hz": [0, 0, 9999.0, 0, 0, 0]}),
    ("must be from 0 to 1e+07 Hz", {"disturbance.frequency_hz": [-1.0, *[0] * 5]}),
    (
        "row 2 begins with 1 after 2",
        {"current.table": [[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]]},
    ),
    # keys, and the words that were meant
    (
        "2 errors … current.speed: -1 must … wall.stifness: no such key; did you mean 'stiffness'",
        {"wall.stifness": 1, "current.speed": -1},
    ),
    ("did you mean 'tether.stiffness' or 'wall.stiffness' or 'bumper.stiffness'?", "stiffness=1.0"),
    ("did you mean 'controller.k_1'?", "k_1=1.0"),
    ("did you mean 'wall'?", "wal.stiffness=1.0"),
    ("position: is not a dotted key", "position=1.0"),
    (
        "initial.position[0]: a part of a list can't be set; give the whole list, initial.posi",
        "initial.position[0]=1.0",
    ),
    ("a part of a list can't be set; give the whole list, reference.poses", "reference.poses[0].dwell=1.0"),
    ("wall: is a table; its keys are wall.position, wall.stiffness", "wall=1.0"),
    ("controller: is a table; its keys are controller.name", "controller=1.0"),
    ("sensor.name: no table 'sensor'; the table is called navigation: navigation.name", "sensor.name=1.0"),
    ("no table 'sensors'; the table is called navigation: navigation.sigma", "sensors.sigma=1.0"),
    ("the table is called reference: reference.name", "guidance.name=1.0"),
    ("the table is called controller: controller.name", "law.name=1.0"),
    ("the table is called controller: controller.k_1", "control.k_1=1.0"),
    ("law: is not a dotted key; the table is called controller: controller.name", "law=1.0"),
    ("the table is called controller: controller.name=mine.py:Mine", {"law": "mine.py:Mine"}),
    ("navigation: is a table; navigation.name=mine.py:Mine chooses the navigation", {"navigation": "mine.py:Mine"}),
    *(("simulation.seed", {"simulation.seed": seed}) for seed in (-1, 1.5, "x", True)),
    # numbers as people write them
    *(
        (f"; {hint}", setting)
        for setting, hint in [
            ("current.speed=0,5", "a number has a decimal point and no comma: 0.5"),
            ("controller.k_1=-8,6e1", "a number has a decimal point and no comma: -8.6e1"),
            ("wall.stiffness=20,000", "a number has a decimal point and no comma"),  # 20 or 20000
            ("wall.stiffness=2e4N", "write the number alone, in N/m"),
            ("wall.stiffness=20kN/m", "write the number alone, 20000, in N/m"),
            ("wall.stiffness=2e4 N/m", "write the number alone, 20000, in N/m"),
            ("reference.step_time=1500ms", "write the number alone, 1.5, in s"),
            ("current.direction_deg=45deg", "write the number alone, 45, in deg"),
            ("current.direction_deg=-45°", "write the number alone, -45, in deg"),
            ("current.direction_deg=1.5708 rad", "write the number alone, 90.0002, in deg"),
            ('initial.position=["1.5 m", 0, 0]', "write the number alone, 1.5, in m"),
            ('controller.k_1="5"', "write it without quotes, 5"),
            ("vehicle.mass=11.5kg", "the key is a factor or a share, without a unit, and not a value in kg"),
            (
                'walls=[{shape="plane", position=[1, 0, 0], stiffness="20 kN/m"}]',
                "write the number alone, 20000, in N/m",
            ),
        ]
    ),
    (NOT_TOML, "initial.position=[1.5 m, 0, 0]"),
    *(("is not a finite number", {"wall.stiffness": value}) for value in ("soft", "nan", "1 2", "", "N")),
]
OF_A_FILE = [
    ("wall: 3 is not a table", "wall = 3"),
    ("controller: 3 is not a table", "controller = 3"),
    ("controller.name: 3 is not the name of any law", "[controller]\nname = 3"),
    ("wall.position: True is not a finite number", "[wall]\nposition = true"),
    ("did you mean 'gsta'?", "[controller]\nname = 'gtsa'"),
    ("task.A", "[task]\nA = 1.0"),
    ('posture.order: \'joints\' must be a list with any of "attitude", "station" and', "[posture]\norder = 'joints'"),
    ("reference.waypoints: 3 is not a list of tables with time, position", "[reference]\nwaypoints = 3"),
    ("impedance.schedule: 3 is not a list of tables with time, ", "[impedance]\nschedule = 3"),
    ("walls: 3 is not a list of tables with shape, position, ", "walls = 3"),
    ("initial.joints: 3 is not a list of numbers", "[initial]\njoints = 3"),
    (
        "impedance.K_f: 2 is not a list of numbers; its default is [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]",
        "[impedance]\nK_f = 2",
    ),
    ("reference.waypoints[0].position: ", "[[reference.waypoints]]\ntime = 1.0"),
    ("not a scenario in TOML", "x = ["),
    (
        "law … sensor: no table 'sensor'; the table is called navigation: navigation.name … wall.stifness",
        "law = 'gsta'\n[sensor]\nname = 'perfect'\n[wall]\nstifness = 1.0",
    ),
    ("line 2 … ; a number has a decimal point and no comma: 0.5", "[current]\nspeed = 0,5  # m/s\n"),
    ("line 2 … ; write the number alone, in the unit of the key", "[wall]\nstiffness = 20kN/m\n"),
    (
        "9 errors … controller.k1: gsta has no such gain; did you mean 'k_1'? … controller.k_2: -1 must be at least 0 "
        "… wall.damping: -2 must be from 0 to 1e+09 N s/m … wall.stifness: no such key; did you mean 'stiffness'?",
        "[wall]\nstifness = 1e5\ndamping = -2\n[simulation]\ntimestep = 'fast'\nintegrator = 'rk4'\n[initial]\n"
        "position = [1, 2]\n[refrence]\ntarget = [1, 2, 3]\n[disturbance]\nbias = [0, 0, 0, 0, nan, 0]\n"
        "[controller]\nname = 'gsta'\nk1 = 3\nk_2 = -1\n",
    ),
    ("simulation.timestep: 'fast' is not a finite number", "[simulation]\ntimestep = 'fast'"),
    ("simulation.integrator: 'rk4' must be 'euler' or 'implicitfast'", "[simulation]\nintegrator = 'rk4'"),
    ("initial.position: [1, 2] has 2 values; 3 are needed", "[initial]\nposition = [1, 2]"),
    ("refrence: no such key; did you mean 'reference'?", "[refrence]\ntarget = [1, 2, 3]"),
    ("disturbance.bias[4]: nan is not a finite number", "[disturbance]\nbias = [0, 0, 0, 0, nan, 0]"),
]


def said(words):
    """A pattern for the parts of a message in their order."""
    return re.compile(".*".join(map(re.escape, words.split(" … "))), re.DOTALL)


def start(scenario):
    """Check it, and only then make what runs it."""
    checked(scenario)
    Simulation(scenario, engine="free_body", looks=False).close()


@pytest.fixture(scope="module")
def running():
    """A Simulation on its way."""
    with Simulation(Scenario.load("push_wall"), engine="free_body") as sim:
        sim.step(20)
        yield sim


@pytest.mark.parametrize("row", REFUSED, ids=lambda row: row[0][:60])
def test_a_scenario_that_can_not_run_is_refused_with_its_key_and_what_would_be_right(row, running):
    words, given, *law = row
    if words == NOT_TOML:
        with pytest.raises(InputError, match=said(words)):
            parse_setting(given)
        return
    overrides = dict([parse_setting(given)]) if isinstance(given, str) else given
    with pytest.raises(InputError, match=said(words)) as refused:
        start(Scenario.load("push_wall", overrides, *law))
    assert re.match(r"(push_wall|scenario): |.* no finite result", str(refused.value))
    if law or any(key.startswith("vehicle.") or key.endswith(".name") for key in overrides):
        return  # for which a reset has another answer
    before = [np.array(running.signals[name]) for name in running.signals]
    with pytest.raises(InputError, match=said(words.removeprefix("push_wall: "))):
        running.reset(overrides)
    assert all(map(np.array_equal, before, [running.signals[name] for name in running.signals]))


@pytest.mark.parametrize("row", OF_A_FILE, ids=lambda row: row[0][:60])
def test_a_file_that_is_no_scenario_is_refused_in_words_that_name_the_place(row, tmp_path):
    words, text = row
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(InputError, match=said(words)):
        Scenario.load(tmp_path / "mine.toml")


HUGE = [(key, default) for key, default, _ in keys() if isinstance(default, float | tuple) and default != ()]


def test_every_quantity_has_a_range():
    for key, default in HUGE:
        for value in (1e308, -1e308, 10**400):
            with pytest.raises(InputError, match=said(f"{key} … ")) as caught:
                Scenario.load("push_wall", {key: [value] * len(default) if isinstance(default, tuple) else value})
            assert "must" in str(caught.value) or "not a finite number" in str(caught.value)
