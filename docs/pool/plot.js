// The samples of a run over time, and their plots.

const WINDOW_S = 20, ROW = 15;

// The last samples of a run: t, push F, x and the norm of s.
class Track {
  constructor(law) {
    this.law = law;
    this.n = 0;
    this.most = 2 * Math.ceil(WINDOW_S / DATA.sample_s);
    this.columns = ["t", "F", "x", "s"];
    for (const name of this.columns) this[name] = new Float64Array(this.most);
  }

  add(rows) {
    for (let at = 0; at < rows.length; at += ROW) {
      if (this.n === this.most) {
        for (const name of this.columns) this[name].copyWithin(0, this.most / 2);
        this.n = this.most / 2;
      }
      [this.t[this.n], this.F[this.n], this.x[this.n]] = [rows[at], rows[at + 1], rows[at + 2]];
      this.s[this.n++] = Math.hypot(...rows.subarray(at + 9, at + 15));
    }
  }

  // The mean push of the last so many seconds.
  mean(seconds) {
    const first = Math.max(0, this.n - Math.round(seconds / DATA.sample_s));
    return this.F.subarray(first, this.n).reduce((sum, F) => sum + F, 0) / Math.max(1, this.n - first);
  }

  get end() {
    return this.n ? this.t[this.n - 1] : 0;
  }

  // Index of the first sample at or after a time.
  since(t) {
    let low = 0, high = this.n;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.t[middle] < t) low = middle + 1;
      else high = middle;
    }
    return low;
  }
}

// Round steps between the marks of an axis: at most `most` of them.
function marks(low, high, most) {
  const raw = (high - low) / most, ten = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * ten).find((each) => each >= raw);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

// A whole number as an exponent.
const raised = (number) => Array.from(String(Math.round(number)), (digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit] ?? "⁻").join("");

// A plot of one column of tracks, the last of which is the run. `lines` are levels: [{at, dash, name, colour}].
function draw_plot(canvas, paint, tracks, column, { low, high, log = false, lines = [] }) {
  const { ink, width, height } = pen(canvas), now = tracks[tracks.length - 1];
  const [left, top, right, bottom] = [44, 6, width - 8, height - 20];
  const start = Math.max(0, now.end - WINDOW_S);
  const across = (t) => left + ((t - start) / WINDOW_S) * (right - left);
  const scaled = (v) => (log ? Math.log10(Math.max(v, 1e-30)) : v);
  const along = (v) => bottom - ((scaled(v) - low) / (high - low)) * (bottom - top);
  ink.clearRect(0, 0, width, height);
  ink.font = "12px system-ui, sans-serif";
  ink.lineWidth = 1;
  ink.strokeStyle = paint.line;
  ink.fillStyle = paint.muted;
  ink.textAlign = "right";
  ink.textBaseline = "middle";
  const up = marks(low, high, log ? 4 : Math.max(2, Math.floor((bottom - top) / 34)));
  for (const value of up.found) {
    const y = Math.round(log ? bottom - ((value - low) / (high - low)) * (bottom - top) : along(value)) + 0.5;
    ink.beginPath();
    ink.moveTo(left, y);
    ink.lineTo(right, y);
    ink.stroke();
    ink.fillText(log ? `10${raised(value)}` : value.toFixed(up.digits).replace("-", "−"), left - 6, y);
  }
  ink.textBaseline = "alphabetic";
  const times = marks(start, start + WINDOW_S, width < 260 ? 3 : 5).found;
  for (const t of times) {
    const last = t === times[times.length - 1], at_edge = across(t) > right - 20;
    ink.textAlign = at_edge ? "right" : "center";
    ink.fillText(last ? `${t.toFixed(0)} s` : t.toFixed(0), at_edge ? right + 6 : across(t), height - 5);
  }
  ink.save();
  ink.beginPath();
  ink.rect(left, top - 4, right - left, bottom - top + 8);
  ink.clip();
  for (const track of tracks) {
    const present = track === now;
    ink.globalAlpha = present ? 1 : 0.4;
    ink.strokeStyle = DATA.colours[track.law];
    ink.lineWidth = present ? 2 : 1.25;
    ink.lineJoin = "round";
    ink.beginPath();
    // of all samples in a column of pixels, the least and the largest
    let pixel = -1, least = 0, largest = 0;
    for (let k = track.since(start); k < track.n; k++) {
      const here = Math.floor(across(track.t[k])), y = along(track[column][k]);
      if (here !== pixel) {
        if (pixel >= 0) ink.lineTo(pixel, least), largest - least > 1 && ink.lineTo(pixel, largest);
        [pixel, least, largest] = [here, y, y];
      } else [least, largest] = [Math.min(least, y), Math.max(largest, y)];
    }
    if (pixel >= 0) ink.lineTo(pixel, least), ink.lineTo(pixel, largest);
    ink.stroke();
    ink.globalAlpha = 1;
  }
  for (const line of lines) {
    ink.setLineDash(line.dash || []);
    ink.strokeStyle = line.colour;
    ink.lineWidth = 1.5;
    ink.beginPath();
    ink.moveTo(left, along(line.at));
    ink.lineTo(right, along(line.at));
    ink.stroke();
  }
  ink.setLineDash([]);
  for (const line of lines.filter((each) => each.name)) {
    ink.fillStyle = line.colour;
    ink.textAlign = line.left ? "left" : "right";
    ink.fillText(line.name, line.left ? left + 6 : right - 4, along(line.at) - 5);
  }
  ink.restore();
}
