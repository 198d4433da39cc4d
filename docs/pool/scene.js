// The scene: the vehicle at the wall, from the side. x points to the wall, z up.

const SCENE = { left: -0.42, right: 1.46, newton: 0.05 }; // edges in W [m]; length of a force's arrow [m/N]

// A canvas as large as its place on the page, with its pen in CSS pixels.
function pen(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas, ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const ink = canvas.getContext("2d");
  ink.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { ink, width, height };
}

// The colours of the page's theme, by their names in pool.css.
function paints(root) {
  const style = getComputedStyle(root), known = {};
  return new Proxy(known, {
    get: (_, name) => (known[name] ??= style.getPropertyValue(`--pool-${name.replaceAll("_", "-")}`).trim()),
  });
}

function arrow(ink, x, y, dx, dy, colour, thick = 4) {
  const length = Math.hypot(dx, dy), head = Math.min(length, 3 * thick);
  if (length < 2) return;
  const [ux, uy] = [dx / length, dy / length], [bx, by] = [x + dx - head * ux, y + dy - head * uy];
  ink.strokeStyle = ink.fillStyle = colour;
  ink.lineWidth = thick;
  ink.lineCap = "butt";
  ink.beginPath();
  ink.moveTo(x, y);
  ink.lineTo(bx + ux, by + uy);
  ink.stroke();
  ink.beginPath();
  ink.moveTo(x + dx, y + dy);
  ink.lineTo(bx - 0.55 * head * uy, by + 0.55 * head * ux);
  ink.lineTo(bx + 0.55 * head * uy, by - 0.55 * head * ux);
  ink.fill();
}

// Text with a ground of its own, so that it can be read on water and wall.
function label(ink, text, x, y, paint, colour, align = "left") {
  ink.font = "600 13px system-ui, sans-serif";
  ink.textBaseline = "middle";
  const width = ink.measureText(text).width + 10, wide = ink.canvas.clientWidth - width - 6;
  const left = Math.max(6, Math.min(wide, align === "right" ? x - width : align === "center" ? x - width / 2 : x));
  ink.fillStyle = paint.label;
  ink.beginPath();
  ink.roundRect(left, y - 10, width, 20, 4);
  ink.fill();
  ink.fillStyle = colour;
  ink.textAlign = "left";
  ink.fillText(text, left + 5, y + 0.5);
}

// Snow in the water, at fixed places of a repeating pattern that drifts with the current.
const SNOW = Array.from({ length: 70 }, (_, k) => {
  const part = (share) => (k * share) % 1;
  return { x: part(0.7549), y: part(0.5698), size: 0.6 + 1.4 * part(0.618) };
});

function water(ink, width, height, paint, drift, face) {
  const shade = ink.createLinearGradient(0, 0, 0, height);
  shade.addColorStop(0, paint.water_top);
  shade.addColorStop(1, paint.water_bottom);
  ink.fillStyle = shade;
  ink.fillRect(0, 0, width, height);
  ink.fillStyle = paint.snow;
  for (const flake of SNOW) {
    const x = ((((flake.x + drift) % 1) + 1) % 1) * width;
    if (x < face) ink.beginPath(), ink.arc(x, flake.y * height, flake.size, 0, 7), ink.fill();
  }
  const floor = Math.min(34, 0.09 * height); // tiles, smaller at the back
  ink.fillStyle = paint.floor;
  ink.fillRect(0, height - floor, face, floor);
  ink.strokeStyle = paint.joint;
  ink.lineWidth = 1;
  ink.beginPath();
  for (const y of [0, 0.3, 0.65]) ink.moveTo(0, height - floor * (1 - y) + 0.5), ink.lineTo(face, height - floor * (1 - y) + 0.5);
  for (let k = -30; k <= 30; k++) ink.moveTo(face / 2 + 38 * k, height - floor), ink.lineTo(face / 2 + 60 * k, height);
  ink.stroke();
}

// The wall behind its face, which the vehicle dents by `depth` [px] at the height y.
function wall(ink, width, height, paint, face, y, depth) {
  const dent = (from) => {
    ink.moveTo(face, from);
    ink.lineTo(face, y - 60);
    ink.bezierCurveTo(face, y - 20, face + depth, y - 24, face + depth, y);
    ink.bezierCurveTo(face + depth, y + 24, face, y + 20, face, y + 60);
    ink.lineTo(face, height);
  };
  ink.save();
  ink.beginPath();
  dent(0);
  ink.lineTo(width, height);
  ink.lineTo(width, 0);
  ink.closePath();
  ink.fillStyle = paint.wall;
  ink.fill();
  ink.clip();
  ink.strokeStyle = paint.hatch;
  ink.lineWidth = 1;
  ink.beginPath();
  for (let x = face - height; x < width; x += 14) ink.moveTo(x, height), ink.lineTo(x + height, 0);
  ink.stroke();
  ink.restore();
  ink.beginPath();
  dent(0);
  ink.strokeStyle = paint.face;
  ink.lineWidth = 2.5;
  ink.stroke();
}

// The BlueROV1 in metres of its body frame: x forward, z up. The places come from its MJCF file.
function vehicle(ink, paint) {
  const box = (x, z, a, b, colour) => ((ink.fillStyle = colour), ink.fillRect(x - a, z - b, 2 * a, 2 * b));
  const tube = (x, z, a, r, colour) => {
    ink.fillStyle = colour;
    ink.beginPath();
    ink.roundRect(x - a, z - r, 2 * a, 2 * r, 0.008);
    ink.fill();
  };
  const strut = (x, z, x_2, z_2) => {
    ink.strokeStyle = paint.frame;
    ink.lineWidth = 0.03;
    ink.lineCap = "round";
    ink.beginPath();
    ink.moveTo(x, z);
    ink.lineTo(x_2, z_2);
    ink.stroke();
  };
  tube(0, -0.0945, 0.13, 0.034, paint.acrylic); // battery
  box(0, -0.0945, 0.09, 0.018, paint.pack);
  for (const x of [-0.136, 0.136]) box(x, -0.0945, 0.008, 0.0355, paint.cap);
  tube(0.039, 0, 0.141, 0.0555, paint.acrylic); // electronics
  box(0.025, -0.018, 0.125, 0.002, paint.tray);
  box(0.085, -0.012, 0.043, 0.004, paint.pcb);
  box(-0.005, -0.008, 0.034, 0.008, paint.cap);
  box(-0.07, -0.01, 0.022, 0.006, paint.blue);
  box(0.187, 0, 0.008, 0.012, paint.cap);
  ink.fillStyle = paint.dome;
  ink.beginPath();
  ink.ellipse(0.187, 0, 0.054, 0.0535, 0, -Math.PI / 2, Math.PI / 2);
  ink.fill();
  ink.strokeStyle = paint.face;
  ink.lineWidth = 0.003;
  ink.stroke();
  box(0.178, 0, 0.008, 0.062, paint.cap);
  box(-0.109, 0, 0.009, 0.0575, paint.cap);
  ink.fillStyle = paint.frame; // lateral thruster, seen along its axis
  ink.beginPath();
  ink.arc(0, 0.104, 0.042, 0, 7);
  ink.fill();
  ink.fillStyle = paint.blue;
  ink.beginPath();
  ink.arc(0, 0.104, 0.034, 0, 7);
  ink.fill();
  ink.fillStyle = paint.frame;
  ink.beginPath();
  ink.arc(0, 0.104, 0.018, 0, 7);
  ink.fill();
  for (const x of [0.18, -0.17]) box(x, 0, 0.042, 0.016, paint.frame), box(x, 0.017, 0.042, 0.003, paint.blue); // vertical
  box(0, 0, 0.016, 0.042, paint.frame); // surge
  box(0.018, 0, 0.003, 0.042, paint.blue);
  strut(0.1, 0.104, 0.2, -0.124);
  strut(-0.12, 0.104, -0.2, -0.124);
  box(-0.01, 0.104, 0.11, 0.016, paint.frame);
  box(-0.01, 0.104, 0.06, 0.005, paint.blue);
  box(-0.004, -0.0585, 0.182, 0.011, paint.frame);
  strut(-0.195, -0.124, 0.195, -0.124);
}

// The current, the wall and the horizontal thrusters from above: x to the right, y up.
function from_above(ink, x, y, size, paint, current, u) {
  const line = (text, at, colour) => ((ink.fillStyle = colour), ink.fillText(text, 0, at));
  ink.save();
  ink.translate(x, y);
  ink.fillStyle = paint.label;
  ink.beginPath();
  ink.roundRect(-size, -size, 2 * size, 2 * size, 6);
  ink.fill();
  ink.clip();
  ink.fillStyle = paint.wall;
  ink.fillRect(0.8 * size, 21 - size, 0.14 * size, 2 * size - 42);
  ink.fillStyle = paint.muted;
  ink.beginPath();
  ink.roundRect(-0.2 * size, -0.16 * size, 0.4 * size, 0.32 * size, 3);
  ink.arc(0.2 * size, 0, 0.1 * size, -1.6, 1.6);
  ink.fill();
  const force = 0.055 * size;
  for (const side of [1, -1]) arrow(ink, -0.2 * size - force * u[side > 0 ? 0 : 1], -side * 0.11 * size, force * u[side > 0 ? 0 : 1], 0, paint.thrust, 2.5);
  arrow(ink, 0, (u[5] > 0 ? 0.16 : -0.16) * size + force * u[5], 0, -force * u[5], paint.thrust, 2.5);
  const [dx, dy] = current.map((v) => 0.9 * size * v);
  arrow(ink, 0.52 * size - dx / 2, dy / 2, dx, -dy, paint.current, 3);
  ink.font = `${size > 50 ? 12 : 11}px system-ui, sans-serif`;
  ink.textAlign = "center";
  ink.textBaseline = "middle";
  line("from above", 11 - size, paint.text);
  line(`current ${Math.hypot(...current).toFixed(2)} m/s`, size - 11, paint.current);
  ink.restore();
}

// Draw an instant: {p, quat, push, u, current, drift}; `x_touch` is the x of B at which contact begins.
function draw_scene(canvas, paint, now, x_touch, probe) {
  const { ink, width, height } = pen(canvas);
  const small = width < 520, scale = width / (SCENE.right - SCENE.left), middle = (small ? 0.7 : 0.55) * height;
  const right = (x) => (x - SCENE.left) * scale, up = (z) => middle - z * scale;
  const face = right(x_touch + probe), [w, x, y, z] = now.quat;
  const tip_x = now.p[0] + probe * (1 - 2 * (y * y + z * z)), tip_z = now.p[2] + probe * 2 * (x * z - w * y);
  water(ink, width, height, paint, (now.drift * scale) / width, face);
  wall(ink, width, height, paint, face, up(tip_z), Math.max(0, right(tip_x) - face));
  ink.save();
  ink.translate(right(now.p[0]), up(now.p[2]));
  const [e_xx, e_xz, e_zx, e_zz] = [1 - 2 * (y * y + z * z), 2 * (x * z - w * y), 2 * (x * z + w * y), 1 - 2 * (x * x + y * y)];
  ink.transform(scale * e_xx, -scale * e_xz, scale * e_zx, -scale * e_zz, 0, 0);
  vehicle(ink, paint);
  ink.restore();
  const X = now.u[0] + now.u[1], newton = SCENE.newton * scale; // the surge thrusters
  const back = right(now.p[0]) - 0.235 * scale, level = up(now.p[2]);
  arrow(ink, X > 0 ? back - X * newton : back, level, X * newton, 0, paint.thrust, 5);
  label(ink, `thrust ${X.toFixed(1).replace("-", "−")} N`, back - 8, level + 26, paint, paint.thrust, "right");
  for (const [at, Z] of [[0.18, now.u[2] + now.u[3]], [-0.17, now.u[4]]]) // the vertical ones
    arrow(ink, right(now.p[0] + at), level + Math.sign(Z) * 0.16 * scale + Z * newton, 0, -Z * newton, paint.thrust, 4);
  const force = now.push * newton;
  if (now.push > 0) {
    arrow(ink, right(tip_x) + force, up(tip_z), -force, 0, paint.force, 5);
    label(ink, `${now.push.toFixed(now.push < 10 ? 2 : 1)} N`, face + 12, up(tip_z) - 26, paint, paint.force);
  }
  const size = small ? 50 : 60;
  from_above(ink, size + 8, size + 8, size, paint, now.current, now.u);
  if (!small) label(ink, `wall`, (face + width) / 2, height - 52, paint, paint.text, "center");
}
