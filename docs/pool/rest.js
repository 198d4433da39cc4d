// The rest of a law in closed form: what its push on the wall should come to.

// The push at rest on the spring of the wall under K_d eta_e = tau_c - F_d + b, with the wall's normal n in B [N].
function balanced(values, n, b) {
  const F_d = values["impedance.F_d[0]"];
  let distance = DATA.x_d - DATA.x_c, give = 1 / values["wall.stiffness"];
  for (let i = 0; i < 3; i++) {
    const K_d = values[`impedance.K_d[${i}]`];
    distance += (n[i] * (b[i] - (i === 0 ? F_d : 0))) / K_d;
    give += (n[i] * n[i]) / K_d;
  }
  return Math.max(0, distance / give);
}

// The push that the desired impedance demands, eq. (7) at rest [N].
const demanded = (values) => balanced(values, [1, 0, 0], [0, 0, 0]);

// The wrench of the water (6,) on the vehicle at rest in a current (3,), both in B: drag, and Munk's moment.
function of_current([x, y, z]) {
  const drag = [x, y, z].map((v, i) => (DATA.D_linear[i] + DATA.D_quadratic[i] * Math.abs(v)) * v);
  const [p_x, p_y, p_z] = [x, y, z].map((v, i) => DATA.M_A[i] * v);
  return [...drag, p_y * z - p_z * y, p_z * x - p_x * z, p_x * y - p_y * x];
}

// Why a sampled law does not come to rest on the wall, along its normal; empty if it does. A sliding mode law feeds the force
// back, whose mean age (T - h)/2 acts as negative damping: it must be below (D_d/K_f + b_c)/k_c. Impedance control with
// M_d = M_hat feeds none back; its held command must not let the vibration grow from one period to the next.
function vibrates(law, values, D_d) {
  const h = DATA.timestep, T = values["controller.period"], k_c = values["wall.stiffness"];
  const v = DATA.M_d_inv.map((row) => row[0]), compliant = v[0];
  const along = (wrench) => v.reduce((sum, part, i) => sum + part * wrench[i], 0) / compliant;
  const damping = along(v.map((_, i) => v.reduce((sum, part, j) => sum + D_d[6 * i + j] * part, 0)));
  if (law !== "impedance") {
    const age = (T - h) / 2, limit = (damping / compliant + values["wall.damping"]) / k_c;
    return age < limit ? "" : `the force is ${short(1e3 * age)} ms old, and at ${short(1e3 * limit)} ms all damping is lost`;
  }
  const gains = [along(v.map((part, i) => values[`impedance.K_d[${i}]`] * part)), damping];
  const stiff = h * k_c * compliant, step = ([x, u], f) => [x - h * stiff * x + h * u + h * h * f, u - stiff * x + h * f];
  let [first, second, held] = [[1, 0], [0, 1], [0, 0]];
  for (let i = Math.round(T / h); i > 0; i--) [first, second, held] = [step(first, 0), step(second, 0), step(held, 1)];
  const a = first[0] - held[0] * gains[0], b = second[0] - held[0] * gains[1];
  const c = first[1] - held[1] * gains[0], d = second[1] - held[1] * gains[1];
  const half = (a + d) / 2, square = half * half - (a * d - b * c);
  const growth = square < 0 ? Math.sqrt(a * d - b * c) : Math.abs(half) + Math.sqrt(square);
  return growth > 1 ? "the held command does not damp the vibration" : "";
}

// The push of a law at rest [N], or the reason why there is none: {force, reason}. The laws are the nominal control
// minus M_hat K s. At rest (1 - K/A) (K_d eta_e - tau_c + F_d) is the wrench of the current at the attitude of the rest,
// if M_d is M_hat. For GSTA K is infinite.
function at_rest(law, values, D_d = DATA.D_d) {
  const rest = balance(law, values);
  const reason = rest.force > 0 && vibrates(law, values, D_d);
  return reason ? { reason: `at this rate and wall ${reason}` } : rest;
}

function balance(law, values) {
  if (law === "gsta" && !(values["controller.k_1"] && values["controller.k_2"])) return { reason: "GSTA needs k_1 and k_2" };
  if (law === "gsta") return { force: demanded(values) };
  const A = values["task.A"], epsilon = values["controller.epsilon"];
  const K = law === "fosm" ? values["controller.K_s"] / epsilon : 0;
  if (A === 0 && law === "fosm") return K > 0 ? { force: demanded(values) } : { reason: "with A = 0 and K_s = 0, s drifts" };
  if (law === "fosm" && values["controller.period"] * (K - A) >= 2) return { reason: "at this rate the sampled law chatters; a wider ε helps" };
  const share = K > 0 ? 1 / (1 - K / A) : 1, current = DATA.current.map((part) => part * values["current.speed"]);
  let e = [0, 0, 0], wrench, n, change;
  for (let k = 0; k < 200 && !(change < 1e-15); k++) {
    const w = Math.sqrt(1 - Math.hypot(...e) ** 2), [x, y, z] = e; // columns of R_WB below
    const R = [
      [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
      [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
      [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ];
    n = R.map((axis) => axis[0]);
    wrench = of_current(R.map((axis) => axis.reduce((sum, part, i) => sum + part * current[i], 0)));
    const next = e.map((old, i) => old + 0.5 * ((share * wrench[3 + i]) / values[`impedance.K_d[${3 + i}]`] - old));
    change = Math.max(...next.map((each, i) => Math.abs(each - e[i])));
    e = next;
  }
  if (!(change < 1e-9)) return { reason: "the current turns the vehicle too far" };
  const s = DATA.M_d_inv.map((row) => (share * row.reduce((sum, part, i) => sum + part * wrench[i], 0)) / -A);
  if (law === "fosm" && Math.max(...s.map(Math.abs)) >= epsilon) return { reason: "K_s is too small for this current, and s leaves the boundary layer" };
  return { force: balanced(values, n, wrench.map((each) => share * each)) };
}
