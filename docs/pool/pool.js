// The pool: a worker that computes, and the page around it.

// A worker that computes runs.
function computer() {
  const worker = new Worker(URL.createObjectURL(new Blob([WORKER], { type: "text/javascript" })));
  worker.postMessage({ load: DATA });
  return worker;
}

// A whole run at once, without the clock: {rows, start, wall_s}; see whole_run in worker.js.
function simulate(law, values, seconds, during) {
  const worker = computer();
  return new Promise((resolve, reject) => {
    worker.onmessage = ({ data }) => {
      if (data.loaded) worker.postMessage({ whole: { law, values, seconds, during } });
      else worker.terminate(), data.failed ? reject(new Error(data.failed)) : resolve(data.whole);
    };
  });
}

const DEFAULTS = Object.fromEntries(DATA.keys.map(({ key, value }) => [key, value]));
const TOLD_MS = 100; // time between two readings of a number
const LAWS = { gsta: "GSTA", fosm: "FOSM", impedance: "Impedance" };
const ABOUT = {
  gsta: "Generalised super-twisting rejects the unknown current: at rest the force is as the desired impedance demands.",
  fosm: "First-order sliding mode keeps s inside its boundary layer ε: at rest a small part of the current's wrench is left.",
  impedance: "Impedance control does not reject the unknown current: the vehicle may stop short of the wall.",
};

// HTML of a text with _subscripts_ and ^superscripts^.
const rich = (text) => text.replace(/_([^_]*)_/g, "<sub>$1</sub>").replace(/\^([^^]*)\^/g, "<sup>$1</sup>");
const plain = (text) => text.replace(/[_^]/g, "");

// A number as the page shows it, and back.
const outwards = (key, value) => (key.shown === "rate" ? 1 / value : key.shown === "minus" ? 0 - value : value);
const inwards = (key, shown) =>
  key.choices.length
    ? key.choices.reduce((a, b) => (Math.abs(1 / b - shown) < Math.abs(1 / a - shown) ? b : a))
    : key.shown === "minus" ? 0 - shown : shown;
const short = (value) => {
  if (value !== 0 && (Math.abs(value) >= 1e5 || Math.abs(value) < 1e-3)) {
    const [digits, ten] = value.toExponential(1).split("e");
    return `${digits.replace(/\.0$/, "")}·10^${Number(ten)}^`.replace("-", "−");
  }
  return String(Number(value.toPrecision(3))).replace("-", "−");
};

// The place of a number on its slider, from 0 to 1, and back.
const place_of = (key, shown) =>
  key.choices.length
    ? key.choices.indexOf(inwards(key, shown)) / (key.choices.length - 1)
    : key.steps === "log" ? Math.log(shown / key.least) / Math.log(key.most / key.least)
    : (shown - key.least) / (key.most - key.least);
function number_at(key, place) {
  if (key.choices.length) return Math.round(1 / key.choices[Math.round(place * (key.choices.length - 1))]);
  const exact = key.steps === "log" ? key.least * (key.most / key.least) ** place : key.least + place * (key.most - key.least);
  return Number(exact.toPrecision(key.steps === "log" ? 2 : 3));
}

// The scenario as TOML: all that differs from the default.
function toml(law, values) {
  const tables = new Map([["controller", [`name = "${law}"`]]]), lists = {};
  const text = (value) => (Number.isInteger(value) && Math.abs(value) < 1e15 ? value.toFixed(1) : String(value));
  for (const key of DATA.keys) {
    if (!key.places[law] || values[key.key] === key.value) continue;
    const [, table, word, index] = key.key.match(/^(\w+)\.(\w+)(?:\[(\d)\])?$/);
    if (!tables.has(table)) tables.set(table, []);
    if (index === undefined) tables.get(table).push(`${word} = ${text(values[key.key])}`);
    else lists[`${table}.${word}`] = [table, word];
  }
  for (const [name, [table, word]] of Object.entries(lists)) {
    const entries = DATA.lists[name].map((value, k) => values[`${name}[${k}]`] ?? value);
    tables.get(table).push(`${word} = [${entries.map(text).join(", ")}]`);
  }
  const parts = [...tables].map(([table, lines]) => `[${table}]\n${lines.join("\n")}\n`);
  return ["# uvms-mj run pool.toml --engine free_body\n", ...parts].join("\n");
}

// The law and the numbers of a link, "?law=fosm&current.speed=0.2", with the keys of the scenario. A link that has
// anything else is refused as a whole: {law, values, wrong}.
function asked(query) {
  const { law = "gsta", ...given } = Object.fromEntries(new URLSearchParams(query)), values = { ...DEFAULTS };
  const refuse = (why) => ({ law: "gsta", values: { ...DEFAULTS }, wrong: `This link is not for the pool: ${why}. The run has the default numbers.` });
  if (!(law in LAWS)) return refuse(`law=${law} is none of ${Object.keys(LAWS).join(", ")}`);
  for (const [name, text] of Object.entries(given)) {
    const key = DATA.keys.find((each) => each.key === name && each.places[law]);
    if (!key) return refuse(`${name} is no number of ${LAWS[law]} here`);
    const shown = outwards(key, text.trim() === "" ? NaN : Number(text)), value = inwards(key, shown);
    const offered = key.choices.length ? Math.abs(value * shown - 1) < 1e-9 : shown >= key.least && shown <= key.most;
    if (!offered) return refuse(`${name}=${text} is outside of what the pool offers`);
    values[name] = value;
  }
  return { law, values, wrong: "" };
}

// The query of a link to a law and its numbers: all that differs from the default.
function query_of(law, values) {
  const differs = DATA.keys.filter((key) => key.places[law] && values[key.key] !== key.value);
  return `?${new URLSearchParams([["law", law], ...differs.map(({ key }) => [key, values[key]])])}`;
}

// Copy a text: whether the browser did. A page over http has no clipboard, but the old command.
async function copied(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const field = element("textarea", { readonly: true, style: "position: fixed; opacity: 0" });
    field.value = text;
    document.body.append(field);
    field.select();
    const done = document.execCommand("copy");
    field.remove();
    return done;
  }
}

// A button that copies a text, and says so for a while.
function copier(words, text, otherwise) {
  const button = element("button", { type: "button", onclick: async () => {
    button.textContent = (await copied(text())) ? "Copied" : otherwise;
    setTimeout(() => (button.textContent = words), 1500);
  } }, words);
  return button;
}

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "html") made.innerHTML = value;
    else if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false) made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

// A number that changes too often to be read aloud.
const shown_number = () => element("output", { "aria-live": "off" }, "–");

class Pool {
  constructor(root) {
    this.root = root;
    this.all = "numbers" in root.dataset;
    root.classList.add("uvms-pool");
    root.setAttribute("role", "group");
    root.setAttribute("aria-label", "An underwater vehicle pushes on a wall, computed in this page");
    ({ law: this.law, values: this.values, wrong: this.wrong } = asked(location.search));
    this.old = {};
    this.run = 0;
    this.wants = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.seen = true;
    this.build();
    this.worker = computer();
    this.worker.onmessage = ({ data }) => {
      if (data.failed) this.say(`The computation failed in this browser: ${data.failed}`);
      else if (data.loaded) this.begin();
      else this.take(data);
    };
    // another page of the pool begins with the numbers of this one
    for (const link of document.querySelectorAll('a:is([href*="gains.html"], [href*="numbers.html"], [href*="pool.html"])'))
      link.addEventListener("click", () => (link.search = query_of(this.law, this.values)));
    new IntersectionObserver(([{ isIntersecting }]) => {
      this.seen = isIntersecting;
      this.move();
    }).observe(root);
    new ResizeObserver(() => this.draw_soon()).observe(root);
    const dark = matchMedia("(prefers-color-scheme: dark)"), page = document.documentElement;
    const theme = () => {
      root.classList.toggle("pool-dark", page.dataset.theme ? page.dataset.theme === "dark" : dark.matches);
      this.paint = paints(root);
      this.draw_soon();
    };
    theme();
    dark.addEventListener("change", theme);
    new MutationObserver(theme).observe(page, { attributeFilter: ["data-theme"] });
  }

  build() {
    const canvas = (words) => element("canvas", { role: "img", "aria-label": words });
    this.scene = canvas("Side view: the vehicle, the wall, the contact force, the thrust and the current");
    const laws = Object.entries(LAWS).map(([law, name]) =>
      element("label", { style: `--law: ${DATA.colours[law]}` },
        element("input", { type: "radio", name: "pool-law", value: law, checked: law === this.law, onchange: () => this.choose(law) }),
        element("span", {}, name)));
    this.play = element("button", { type: "button", onclick: () => ((this.wants = !this.wants), this.move()) }, this.wants ? "Pause" : "Play");
    const again = element("button", { type: "button", onclick: () => ((this.wants = true), this.begin()) }, "Start again");
    const pace = element("select", { "aria-label": "speed of the run", onchange: () => this.worker.postMessage({ pace: Number(pace.value) }) },
      ...[0.25, 1, 4].map((times) => element("option", { value: times, selected: times === 1 }, `${times}×`)));
    this.told = {};
    const number = (name, words) => {
      this.told[name] = shown_number();
      return element("div", {}, element("span", { html: words }), this.told[name]);
    };
    this.plots = {};
    const plot = (column, title) => {
      this.plots[column] = canvas(`Plot over time: ${title.replace(/<[^>]*>/g, "")}`);
      return element("div", {}, element("span", { html: title }), this.plots[column]);
    };
    this.message = element("p", { class: "pool-message", role: "status" });
    this.about = element("p", { class: "pool-about" });
    this.controls = element("div", { class: "pool-keys" });
    const plots = element("div", { class: "pool-plots" },
      plot("F", "Contact force <i>F</i> [N]"), plot("x", "Position <i>x</i> [m]"),
      plot("s", "Sliding variable ‖<i>s</i>‖ [m/s, rad/s]"));
    this.root.replaceChildren(
      element("div", { class: "pool-board" },
        element("div", { class: "pool-stage" }, this.scene, this.message),
        element("div", { class: "pool-choice" },
          element("fieldset", { class: "pool-laws" }, element("legend", {}, "Control law"), ...laws),
          element("div", { class: "pool-bar" }, this.play, again, pace)),
        element("div", { class: "pool-told" },
          number("F", "contact force, mean of 0.25 s"), number("rest", "closed form at rest"),
          number("gap", "distance to the wall"), number("peak", "peak force"),
          number("s", "‖<i>s</i>‖ [m/s, rad/s]"), number("t", "time")),
        ...(this.all ? [plots, this.controls, this.build_toml()] : [this.controls, plots])), // sliders below the numbers
      this.about,
      element("p", { class: "pool-note" },
        element("span", { html: rich("The desired impedance at rest, eq. (7): <i>F</i> = (<i>K</i>_d,x_ (<i>x</i>_d_ − <i>x</i>_c_) − <i>F</i>_d,x_) / (1 + <i>K</i>_d,x_ / <i>k</i>_c_) = ") }),
        (this.told.demanded = shown_number()), ". ", (this.speed = element("span"))));
    this.build_keys();
  }

  build_keys() {
    const keys = DATA.keys.filter((key) => key.places[this.law] && (this.all || key.first));
    this.controls.classList.toggle("pool-fields", this.all);
    const defaults = element("button", { type: "button", onclick: () => this.restore() }, "Default numbers");
    const link = copier("Copy link", () => this.link(), "It is in the address bar");
    this.controls.replaceChildren(...keys.map((key) => (this.all ? this.field(key) : this.slider(key))),
      element("div", { class: "pool-bar" }, defaults, link));
    this.tell_scenario();
  }

  // The address of this page with the numbers. The address bar has it from then on.
  link() {
    const address = location.href.replace(/[?#].*$/, "") + query_of(this.law, this.values);
    try {
      history.replaceState(null, "", address);
    } catch {} // of a page from a file
    return address;
  }

  slider(key) {
    const shown = outwards(key, this.values[key.key]), value = shown_number();
    const tell = (number) => (value.innerHTML = rich(`${short(number)} ${key.unit}`));
    const steps = key.choices.length ? key.choices.length - 1 : 200;
    let before; // a finger that scrolls the page may begin on a slider
    const range = element("input", {
      type: "range", min: 0, max: steps, step: 1, value: Math.round(place_of(key, shown) * steps),
      onpointerdown: () => (before = this.values[key.key]),
      onpointercancel: () => {
        range.value = Math.round(place_of(key, outwards(key, before)) * steps);
        take(outwards(key, before));
      },
      oninput: () => take(number_at(key, range.value / steps)),
    });
    const take = (number) => {
      tell(number);
      describe(number);
      this.change(key, inwards(key, number));
    };
    const describe = (number) => range.setAttribute("aria-valuetext", plain(`${short(number)} ${key.unit}`));
    tell(shown);
    describe(shown);
    return element("label", {}, element("span", { html: `${rich(key.words)} <i>${rich(key.symbol)}</i>` }), value, range);
  }

  field(key) {
    const shown = outwards(key, this.values[key.key]);
    const input = key.choices.length
      ? element("select", { onchange: () => this.change(key, inwards(key, Number(input.value))) },
          ...key.choices.map((choice) => Math.round(1 / choice)).map((rate) => element("option", { value: rate, selected: rate === Math.round(shown) }, String(rate))))
      : element("input", {
          type: "number", step: "any", min: key.least, max: key.most, value: shown, inputmode: "decimal",
          onchange: () => {
            const valid = input.value !== "" && input.checkValidity();
            input.setAttribute("aria-invalid", String(!valid));
            if (valid) this.change(key, inwards(key, input.valueAsNumber));
            wrong.textContent = valid ? "" : `a number from ${plain(short(key.least))} to ${plain(short(key.most))}; still ${plain(short(outwards(key, this.values[key.key])))}`;
            this.save.disabled = Boolean(this.controls.querySelector("[aria-invalid=true]"));
          },
        });
    const wrong = element("small", { class: "pool-wrong", role: "alert" });
    const range = key.choices.length ? "" : `, ${short(key.least)} to ${short(key.most)}`;
    return element("label", { title: `${plain(`${key.words}${range} ${key.unit}`)}: ${key.key}` },
      element("span", { html: `${rich(key.words)} <i>${rich(key.symbol)}</i>` }), input, element("span", { class: "pool-unit", html: rich(key.unit) }), wrong);
  }

  build_toml() {
    this.scenario = element("textarea", { readonly: true, rows: 10, spellcheck: "false", "aria-label": "the scenario as TOML" });
    const copy = copier("Copy", () => this.scenario.value, "Select the text");
    const save = this.save = element("button", { type: "button", onclick: () => {
      const address = URL.createObjectURL(new Blob([this.scenario.value], { type: "application/toml" }));
      element("a", { href: address, download: "pool.toml" }).click();
      setTimeout(() => URL.revokeObjectURL(address), 1000);
    } }, "Save pool.toml");
    return element("div", { class: "pool-toml" },
      element("span", {}, "Scenario: what differs from the default"), this.scenario, element("div", { class: "pool-bar" }, save, copy));
  }

  tell_scenario() {
    const { force, reason } = at_rest(this.law, this.values, this.said?.D_d);
    this.rest = force;
    this.told.rest.textContent = reason ? "–" : `${force.toFixed(3)} N`;
    this.told.demanded.textContent = `${demanded(this.values).toFixed(3)} N`;
    this.about.textContent = reason ? `No closed form: ${reason}.` : ABOUT[this.law];
    if (this.scenario) this.scenario.value = toml(this.law, this.values);
    this.draw_soon();
  }

  change(key, value) {
    this.values[key.key] = value;
    this.worker.postMessage({ set: { [key.key]: value } });
    this.tell_scenario();
  }

  restore() {
    this.values = { ...DEFAULTS };
    this.worker.postMessage({ set: this.chosen() });
    this.build_keys();
    if (this.save) this.save.disabled = false;
    this.controls.lastChild.firstChild.focus();
  }

  choose(law) {
    if (this.track) this.old[this.law] = this.track;
    delete this.old[law];
    this.law = law;
    this.build_keys();
    this.begin();
  }

  // The numbers that the law has.
  chosen() {
    return Object.fromEntries(DATA.keys.filter((key) => key.places[this.law]).map(({ key }) => [key, this.values[key]]));
  }

  begin() {
    this.track = new Track(this.law);
    this.drift = 0;
    this.stopped = false;
    this.say(this.wrong);
    this.wrong = "";
    this.worker.postMessage({ start: { law: this.law, values: this.chosen(), run: ++this.run } });
    this.move();
  }

  // Let the run go on, or hold it.
  move() {
    const goes = this.wants && this.seen && !this.stopped;
    this.worker.postMessage({ running: goes });
    this.play.textContent = this.wants ? "Pause" : "Play";
    this.told_at = -Infinity; // whatever the age of the page is
    this.draw_soon();
  }

  take(said) {
    if (said.run !== this.run) return;
    const before = this.track.end;
    this.track.add(said.rows);
    const damped = this.said && String(this.said.D_d) !== String(said.D_d);
    this.said = said;
    if (damped) this.tell_scenario(); // K_d has changed D_d
    this.drift += (this.track.end - before) * said.v_c_W[0];
    if (said.stopped) {
      this.stopped = true;
      this.say(`The run has diverged at ${this.track.end.toFixed(2)} s: its motion or its command left its bounds. Change a number and start again.`);
    }
    if (!this.ready) performance.mark((this.ready = "uvms-mj-pool"));
    this.draw_soon();
  }

  say(text) {
    this.message.textContent = text;
  }

  draw_soon() {
    if (this.drawing) return;
    this.drawing = true;
    requestAnimationFrame(() => {
      this.drawing = false;
      if (this.said && this.track?.n) this.draw();
    });
  }

  // Write the numbers of the instant.
  tell(distance) {
    const { said, track, told } = this;
    this.told_at = performance.now();
    told.F.textContent = `${track.mean(0.25).toFixed(3)} N`;
    told.gap.textContent = Math.abs(distance) < 1e-4 ? `${(1e6 * distance).toFixed(1)} µm` : `${(1e3 * distance).toFixed(1)} mm`;
    told.gap.textContent = told.gap.textContent.replace("-", "−");
    told.peak.textContent = `${said.force_peak[0].toFixed(2)} N`;
    told.s.innerHTML = rich(short(track.s[track.n - 1]));
    told.t.textContent = `${track.end.toFixed(1)} s`;
    if (track.end > 0.5) this.speed.textContent = `Computed in your browser, ${Math.max(1, Math.round(said.times_real))} times as fast as real time.`;
  }

  draw() {
    const { said, track, paint } = this, last = said.rows.length - ROW, at = (k) => said.rows[last + k];
    const x = at(2), force = this.rest, distance = DATA.x_c - x;
    draw_scene(this.scene, paint, {
      p: [x, at(3), at(4)], quat: [at(5), at(6), at(7), at(8)], push: at(1), u: said.u, current: said.v_c_W, drift: this.drift,
    }, DATA.x_c, DATA.probe);
    if (performance.now() - this.told_at > TOLD_MS) this.tell(distance);
    const tracks = [...(track.end <= WINDOW_S ? Object.values(this.old) : []), track];
    const first = track.since(track.end - WINDOW_S);
    const most = (column, least) =>
      tracks.reduce((top, each) => each[column].subarray(each === track ? first : 0, each.n).reduce((a, b) => Math.max(a, b), top), least);
    const dashed = { dash: [6, 4], colour: paint.text };
    draw_plot(this.plots.F, paint, tracks, "F", { low: 0, high: 1.08 * most("F", Math.max(2, 1.4 * (force ?? 0))), lines: force === undefined ? [] : [{ at: force, name: "closed form", ...dashed }] });
    draw_plot(this.plots.x, paint, tracks, "x", { low: -0.05, high: 0.15 + most("x", DATA.x_c), lines: [{ at: DATA.x_c, name: "contact", left: true, ...dashed }] });
    draw_plot(this.plots.s, paint, tracks, "s", { low: -10, high: 0.5 + Math.log10(most("s", 1)), log: true });
  }
}

function mount() {
  const root = document.getElementById("pool");
  if (!root) return;
  document.head.append(element("style", {}, STYLE));
  new Pool(root);
}

window.uvms_mj_pool = { simulate, at_rest: (law, values, D_d) => at_rest(law, { ...DEFAULTS, ...values }, D_d) };
if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", mount);
else mount();
