// The run: the module, its memory with the record of the run, and a clock.
"use strict";

let data, steps, damping, bytes, numbers, integers, base; // base: place of the record in the numbers of the memory
const images = {};
let law, values, begun, run; // begun: whether the run has a sample; run: its number

async function inflated(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function load(given) {
  data = given;
  const { instance } = await WebAssembly.instantiate(await inflated(data.wasm));
  for (const [name, packed] of Object.entries(data.images)) images[name] = await inflated(packed);
  const { memory, __heap_base: end } = instance.exports;
  const most = Math.max(...Object.values(images).map((image) => image.length));
  base = Math.ceil(end.value / 8);
  memory.grow(Math.max(0, Math.ceil((8 * base + most - memory.buffer.byteLength) / 65536)));
  bytes = new Uint8Array(memory.buffer);
  numbers = new Float64Array(memory.buffer);
  integers = new BigInt64Array(memory.buffer);
  const address = BigInt(8 * base);
  steps = (n) => Number(instance.exports[data.entries.steps](address, BigInt(n), 1n));
  damping = () => instance.exports[data.entries.damping](address);
}

const read = (name) => numbers.subarray(base + data.fields[name][0], base + data.fields[name][0] + data.fields[name][1]);
const whole = (name) => Number(integers[base + data.fields[name][0]]);

// Set the numbers that a key of the scenario sets.
function write(key, value) {
  for (const [place, factor, isWhole] of key.places[law] || []) {
    const number = Array.isArray(factor) ? factor[key.choices.indexOf(value)] : factor * value;
    if (isWhole) integers[base + place] = BigInt(number);
    else numbers[base + place] = number;
  }
  values[key.key] = value;
}

// Set numbers of the scenario, from the next step on.
function set(changes) {
  const changed = data.keys.filter(({ key }) => key in changes && changes[key] !== values[key]);
  for (const key of changed) write(key, changes[key.key]);
  if (changed.some((key) => key.damped)) damping();
}

// Return to the start, with the numbers of a scenario.
function reset(chosen, changes) {
  law = chosen;
  begun = false;
  values = Object.fromEntries(data.keys.map(({ key, value }) => [key, value]));
  bytes.set(images[law], 8 * base);
  integers[base + data.fields.address[0]] = BigInt(8 * base);
  set(changes);
}

const WIDTH = 15;

// Go on to the next sample, which has the instant t_k of the step that was taken last: [t, F, p_WB, quat_WB, s].
function sample(into, at) {
  const wanted = begun ? data.sample_steps : 1;
  begun = true;
  const taken = steps(wanted);
  into[at] = read("t")[0];
  const [touches, f_x] = read("solved");
  into[at + 1] = touches ? -f_x : 0;
  into.set(read("p_WB"), at + 2);
  into.set(read("quat_WB"), at + 5);
  into.set(read("s"), at + 9);
  return taken === wanted;
}

// A whole run at once: its samples, the record at its start, and how long it took. `during` has changes of numbers: [[time, {key: value}], ...].
function whole_run({ law: chosen, values: changes, seconds, during = [] }) {
  reset(chosen, changes);
  const start = bytes.slice(8 * base, 8 * base + images[law].length);
  const every = data.sample_s, n = Math.round(seconds / every) + 1;
  const rows = new Float64Array(n * WIDTH), begin = performance.now();
  let k = 0;
  while (k < n && sample(rows, k * WIDTH)) {
    for (const [time, other] of during) if (Math.round(time / every) === k) set(other);
    k++;
  }
  return { rows: rows.subarray(0, k * WIDTH), start, wall_s: (performance.now() - begin) / 1000 };
}

// A run that goes on with the clock.
let pace = 1, running = false, owed = 0, last = 0, busy_ms = 0, done_s = 0, timer;
const LONGEST_S = 0.1; // a browser that sleeps does not catch up

function tick() {
  const now = performance.now(), every = data.sample_s;
  owed += pace * Math.min(LONGEST_S, (now - last) / 1000);
  last = now;
  const n = Math.floor(owed / every);
  if (n > 0) show(n);
  if (running) timer = setTimeout(tick, 15);
}

function show(n) {
  const every = data.sample_s, rows = new Float64Array(n * WIDTH), begin = performance.now();
  let k = 0, goes_on = true;
  while (k < n && goes_on) goes_on = sample(rows, WIDTH * k++);
  owed -= n * every;
  busy_ms += performance.now() - begin;
  done_s += n * every;
  if (!goes_on) running = false;
  const rest = Object.fromEntries(["u", "v_c_W", "force_peak", "D_d"].map((name) => [name, [...read(name)]]));
  postMessage({ rows: rows.subarray(0, k * WIDTH), ...rest, stopped: !goes_on, times_real: (1000 * done_s) / busy_ms, run }, [rows.buffer]);
}

function move(goes) {
  clearTimeout(timer);
  running = goes;
  last = performance.now();
  if (running) tick();
}

async function obey(said) {
  if (said.load) {
    await load(said.load);
    postMessage({ loaded: true });
  }
  if (said.whole) postMessage({ whole: whole_run(said.whole) });
  if (said.start) {
    reset(said.start.law, said.start.values);
    [owed, run] = [0, said.start.run];
    show(1);
  }
  if (said.pace) pace = said.pace;
  if (said.set && law) set(said.set); // before the start the page keeps them
  if ("running" in said && law) move(said.running);
}

let before = Promise.resolve(); // messages are obeyed one after the other, and the first one takes a while
onmessage = ({ data: said }) => (before = before.then(() => obey(said)).catch((error) => postMessage({ failed: String(error) })));
