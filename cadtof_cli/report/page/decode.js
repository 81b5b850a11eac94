// Turns the data in the page into layers of numbers. report/codes.py writes the data.

const byId = (id) => document.getElementById(id);

const run = JSON.parse(byId("run").textContent);

const FIRST_PHASOR = "first phasor";
const TRUTH = "truth";
const ERROR = "error";
const FIRST_PHASOR_ERROR = "error of first phasor";
const STATUS = "status";
const DIRECT = "direct.depth";
const MOST_KEPT = 8;

async function inflated(id) {
  const text = atob(byId(id).textContent);
  const bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k += 1) bytes[k] = text.charCodeAt(k);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// The values of `count` pixels, whose codes begin at `start`. Codes are stored as differences: first all high bytes, then all low bytes.
function decodedValues(layer, bytes, start, count) {
  const table = layer.kind === "table";
  const values = table ? new Uint32Array(count) : new Float32Array(count);
  let code = 0;
  for (let k = 0; k < count; k += 1) {
    code = (code + (bytes[start + k] << 8) + bytes[start + count + k]) & 65535;
    if (table) values[k] = layer.values[code - 1];
    else if (code === 0) values[k] = NaN;
    else if (code === 65535) values[k] = Infinity;
    else {
      const value = layer.first + (code - 1) * layer.step;
      values[k] = layer.kind === "log" ? Math.exp(value) : value;
    }
  }
  return values;
}

// A frame, or truth, with its layers by name. Sample (i, j) is the pixel at column x0 + i·step and row y0 + j·step.
async function decodedFrame(meta) {
  const bytes = await inflated(meta.data);
  const half = Math.floor(meta.step / 2);
  const x0 = Math.min(half, Math.floor((meta.width - 1) / 2));
  const y0 = Math.min(half, Math.floor((meta.height - 1) / 2));
  const columns = Math.ceil((meta.width - x0) / meta.step);
  const rows = Math.ceil((meta.height - y0) / meta.step);
  const layers = new Map();
  meta.layers.forEach((layer, place) => {
    const values = decodedValues(layer, bytes, 2 * place * columns * rows, columns * rows);
    layers.set(layer.name, { name: layer.name, unit: layer.unit, values });
  });
  return { ...meta, x0, y0, columns, rows, layers };
}

function difference(one, other) {
  return one.values.map((value, k) => value - other.values[k]);
}

function withTruth(frame, truth) {
  const known = truth.layers.get(TRUTH);
  frame.layers.set(TRUTH, known);
  for (const [name, error] of [[DIRECT, ERROR], [FIRST_PHASOR, FIRST_PHASOR_ERROR]]) {
    const layer = frame.layers.get(name);
    if (layer) frame.layers.set(error, { name: error, unit: "m", values: difference(layer, known) });
  }
}

const kept = new Map();

// The frame with a number. The frames that were decoded last are kept.
function frameOf(number) {
  if (!kept.has(number)) {
    const meta = run.frames[number];
    const truth = meta.truth === null ? null : run.truth[meta.truth];
    const decoding = Promise.all([decodedFrame(meta), truth && decodedFrame(truth)]).then(([frame, known]) => {
      if (known) withTruth(frame, known);
      return frame;
    });
    if (kept.size >= MOST_KEPT) kept.delete(kept.keys().next().value);
    kept.set(number, decoding);
  }
  return kept.get(number);
}
