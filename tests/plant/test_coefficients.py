"""Coefficients in a vehicle's file give the matrices of the literature; wrong ones are refused by name."""

import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin import TwinParameters
from uvms_mj import InputError, Scenario, attach, simulate
from uvms_mj.plant.coefficients import KNOWN_NUMERICS
from uvms_mj.plant.dissipation import damping_notes, linear_gain, quadratic_gain
from uvms_mj.plant.vehicle import Vehicle
from vehicles import dissipative, random_parameters, vehicle_xml

seeds = st.integers(0, 2**32 - 1)
STILL = TwinParameters(v_c_W=(0.0, 0.0, 0.0))
MATRICES = ("M_A", "D_linear", "D_quadratic")
SUFFIX = {"M_A": "{}dot", "D_linear": "{}", "D_quadratic": "{0}{0}"}


def numerics(entries: dict[str, np.ndarray | float]) -> str:
    """A <custom> section with some entries and a displaced mass."""
    values = {name: " ".join(repr(float(x)) for x in np.ravel(v)) for name, v in entries.items()}
    return "".join(f'<numeric name="{k}" data="{v}"/>' for k, v in ({"displaced_mass": "7.31"} | values).items())


def derivatives(name: str, matrix: np.ndarray, half: bool = False) -> dict[str, float]:
    """The entries of a matrix with SNAME's names and signs; ``half`` leaves out those given by symmetry."""
    return {
        f"{'XYZKMN'[i]}_{SUFFIX[name].format('uvwpqr'[j])}": -value
        for (i, j), value in np.ndenumerate(matrix)
        if not half or i <= j
    }


def vehicle(entries: dict[str, np.ndarray | float]) -> Vehicle:
    xml = vehicle_xml(STILL)
    before, after = xml[: xml.index("<custom>")], xml[xml.index("</custom>") :]
    return Vehicle.from_model(mujoco.MjModel.from_xml_string(f"{before}<custom>{numerics(entries)}{after}"))


def random_matrices(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(6, 6))
    return {"M_A": a @ a.T, "D_linear": dissipative(rng, 10.0), "D_quadratic": dissipative(rng, 30.0)}


@given(seeds)
def test_a_matrix_and_its_derivatives_are_one_vehicle(seed):
    matrices = random_matrices(seed)
    whole = vehicle(matrices)
    apart = vehicle({k: v for name, m in matrices.items() for k, v in derivatives(name, m).items()})
    half = vehicle(
        derivatives("M_A", matrices["M_A"], half=True) | {name: matrices[name] for name in ("D_linear", "D_quadratic")}
    )
    for name, matrix in matrices.items():
        for read in (whole, apart, half):
            assert np.allclose(getattr(read, name), matrix, rtol=1e-15, atol=0)


def test_an_absent_cross_term_is_zero_and_a_known_name():
    """N_v, Y_rr and Y_rdot have the right place and sign; Y_rdot also sets N_vdot."""
    diagonal = {name: np.diag(np.arange(1.0, 7.0)) for name in MATRICES}
    entries = {k: v for name, m in diagonal.items() for k, v in derivatives(name, m).items() if v}
    read = vehicle(entries | {"N_v": -3.1, "Y_rr": -0.3, "Y_rdot": 0.5})
    diagonal["D_linear"][5, 1], diagonal["D_quadratic"][1, 5] = 3.1, 0.3
    diagonal["M_A"][1, 5] = diagonal["M_A"][5, 1] = -0.5
    for name, matrix in diagonal.items():
        assert np.array_equal(getattr(read, name), matrix)
    assert {"displaced_mass", "center_of_buoyancy", "N_v", "Y_rr", "Y_rdot", *MATRICES, *entries} <= KNOWN_NUMERICS
    assert len(KNOWN_NUMERICS) == 2 + 3 + 3 * 36


GOOD = {name: np.diag([10.0, 20, 30, 1, 2, 3]) for name in MATRICES}


def changed(name: str, *entries: tuple[int, int, float]) -> dict[str, np.ndarray | float]:
    matrix = GOOD[name].copy()
    for i, j, value in entries:
        matrix[i, j] = value
    return GOOD | {name: matrix}


@pytest.mark.parametrize(
    ("entries", "reasons"),
    [
        (GOOD | {"N_v": -1.0, "Y_r": 1.0}, ["D_linear: is given together with Y_r, N_v", "not both"]),
        (GOOD | {"D_quadratic": np.ones(35)}, ["D_quadratic: has 35 values; 36 are needed"]),
        (GOOD | {"D_linear": np.ones(6)}, ["D_linear: has 6 values; 36 are needed"]),
        (GOOD | {"D_linear": np.full(36, np.nan)}, ["D_linear: nan: must be finite"]),
        (GOOD | {"D_linear": np.full(36, 1e300)}, ["D_linear: 1e+300: must be finite and at most 1e+15"]),
        (changed("D_linear", (2, 2, -5.0)), ["D_linear, row 3, column 3: -5 is not dissipative", "negative"]),
        (
            changed("M_A", (0, 4, 0.3)),
            ["M_A, row 1, column 5: 0.3, but M_A, row 5, column 1 has 0: added mass"],
        ),
        (changed("M_A", (0, 0, -1.0)), ["M_A, row 1, column 1: -1: must not be negative"]),
        (changed("M_A", (0, 1, 50.0), (1, 0, 50.0)), ["M_A: is not positive semi-definite", "-35.2"]),
        (
            {k: v for k, v in GOOD.items() if k != "M_A"}
            | {k: v for k, v in derivatives("M_A", GOOD["M_A"]).items() if v}
            | {"Y_rdot": -1.0, "N_vdot": -2.0},
            ["Y_rdot: -1, but N_vdot has -2: added mass is symmetric"],
        ),
        (
            {k: v for k, v in GOOD.items() if k != "D_quadratic"} | {"Y_rr": -1.0, "X_uu": 5.0},
            ["X_uu: 5 is not dissipative", "Y_vv: no such", "Z_ww: no such", "K_pp: no such", "M_qq: no", "N_rr: no"],
        ),
    ],
)
def test_every_fault_is_named(entries, reasons):
    with pytest.raises(InputError) as caught:
        vehicle(entries)
    for reason in reasons:
        assert reason in str(caught.value)


LARGE = np.diag([800.0, 1200, 3700, 500, 800, 200])


@pytest.mark.parametrize(("here", "there"), [(10.774, 10.775), (-1.2, -1.3), (0.001, 0.0), (5.0, 6.0)])
def test_an_asymmetry_below_the_printed_digits_is_taken_as_their_mean(here, there):
    M_A = LARGE.copy()
    M_A[2, 4], M_A[4, 2] = here, there
    read = vehicle(GOOD | {"M_A": M_A}).M_A
    assert read[2, 4] == read[4, 2] == pytest.approx((here + there) / 2.0)


@pytest.mark.parametrize(
    ("here", "there", "advice"),
    [
        (10.774, 10.776, "write 10.775, the mean, for both, or correct one of them"),
        (10.5, -10.5, "symmetric; correct one of them"),
        (0.9, 0.0, "symmetric; correct one of them"),  # the lower half was forgotten
        (5.0, 7.0, "symmetric; correct one of them"),
    ],
)
def test_a_larger_asymmetry_is_refused_with_the_way_on(here, there, advice):
    M_A = LARGE.copy()
    M_A[2, 4], M_A[4, 2] = here, there
    with pytest.raises(InputError, match=f"added mass is {advice}|added mass is symmetric; {advice}"):
        vehicle(GOOD | {"M_A": M_A})


def test_the_two_numbers_of_a_small_asymmetry_are_told_apart():
    with pytest.raises(InputError, match=r": 0\.3000002, but .* has 0\.3: .* write 0\.3000001, the mean"):
        vehicle(changed("M_A", (0, 4, 0.3000002), (4, 0, 0.3)))


def test_whole_numbers_of_a_small_vehicle_are_not_taken_as_rounded():
    with pytest.raises(InputError, match="added mass is symmetric"):
        vehicle(changed("M_A", (0, 1, 5.0), (1, 0, 6.0)))


def quadratic_power(D: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """nu^T D (|nu| nu) of velocities (n, 6)."""
    return np.einsum("ni,ij,nj->n", nu, D, np.abs(nu) * nu)


@given(seeds, st.floats(0.05, 1.0))
def test_a_gain_is_found_exactly_where_there_is_one(seed, size):
    """A velocity that is found gains energy; if none is found, none of 2,000 velocities does, in any units."""
    rng = np.random.default_rng(seed)
    D = rng.normal(size=(6, 6)) * size
    D[np.diag_indices(6)] = rng.uniform(0.5, 2.0, 6)
    unit = np.exp(rng.normal(size=6))
    nu = rng.normal(size=(2_000, 6)) * rng.choice([0.1, 1.0], (2_000, 6))
    for find, power, degree in (
        (linear_gain, lambda D, nu: np.einsum("ni,ij,nj->n", nu, D, nu), 1),
        (quadratic_gain, quadratic_power, 2),
    ):
        scaled = D * np.outer(unit, unit**degree)
        found = find(scaled)
        if found is None:
            assert power(scaled, nu / unit).min() >= 0.0
        else:
            assert power(scaled, found[None])[0] < 0.0


@pytest.mark.parametrize("i", range(6))
def test_two_axes_have_a_closed_form(i):
    """x^3 + y^3 - c x y^2 with x, y >= 0 is least along x = sqrt(c/3) y, and negative there for c > 3/4^(1/3)."""
    for c, gains in ((0.999, False), (1.001, True), (-0.999, False), (-1.001, True)):
        D = np.eye(6)
        D[i, i - 1] = c * 3.0 / 4.0 ** (1.0 / 3.0)
        assert (quadratic_gain(D) is not None) == gains
    for c, gains in ((1.999, False), (2.001, True)):  # x^2 + y^2 - c x y
        D = np.eye(6)
        D[i, i - 1] = c
        assert (linear_gain(D) is not None) == gains


def test_a_cross_term_on_an_axis_without_damping_is_a_gain():
    D = np.diag([0.0, 1, 1, 1, 1, 1])
    assert linear_gain(D) is None
    assert quadratic_gain(D) is None
    D[0, 5] = 0.1
    assert linear_gain(D) is not None
    assert quadratic_gain(D) is not None


def noted_power(D_linear: np.ndarray, D_quadratic: np.ndarray, note: str) -> tuple[float, float]:
    """The power at the velocity in a note, and the power stated in the note [W]."""
    nu = np.array(note[note.index("[") + 1 : note.index("]")].split(), dtype=float)
    stated = float(note.split("adds ")[1].split(" W")[0])
    return float(-nu @ (D_linear @ nu + D_quadratic @ (np.abs(nu) * nu))), stated


@pytest.mark.parametrize("name", ["D_linear", "D_quadratic"])
def test_damping_that_feeds_energy_in_is_noted_for_a_run_and_warned_of_by_attach(name, tmp_path):
    """There is one note, with a velocity at which linear and quadratic damping together give the stated power."""
    good = TwinParameters(D_linear=np.diag([4.0, 6, 5, 1, 1, 1]), D_quadratic=np.diag([18.0, 21, 36, 2, 2, 2]))
    D = getattr(good, name).copy()
    D[1, 5], D[5, 1] = 30.0, 20.0
    for parameters, expected in ((good, 0), (replace(good, **{name: D}), 1)):
        (tmp_path / "rov.xml").write_text(vehicle_xml(parameters))
        overrides = {"vehicle.model": str(tmp_path / "rov.xml"), "simulation.duration": 1e-3}
        with warnings.catch_warnings(record=True) as of_the_run:
            warnings.simplefilter("always")
            notes = [note for note in simulate(Scenario.load("push_wall", overrides)).notes if "energy" in note]
        model = mujoco.MjModel.from_xml_string(vehicle_xml(parameters))
        with warnings.catch_warnings(record=True) as of_attach:
            warnings.simplefilter("always")
            attach(model, mujoco.MjData(model)).detach()
        assert len(notes) == expected
        for caught in (of_the_run, of_attach):
            assert [str(w.message) for w in caught if "energy" in str(w.message)] == notes
            assert all(w.filename == __file__ for w in caught)
        for note in notes:
            assert f"cross terms of {name}" in note
            power, stated = noted_power(parameters.D_linear, parameters.D_quadratic, note)
            assert power > 0.0
            assert np.isclose(power, stated, rtol=1e-2)


@given(seeds)
def test_what_dissipates_is_not_noted(seed):
    parameters = random_parameters(seed)
    assert damping_notes("rov", parameters.D_linear, parameters.D_quadratic) == []
