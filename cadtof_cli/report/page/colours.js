// Scales of colours, their ranges, and numbers as texts.

const rgbOf = (text) => [1, 3, 5].map((place) => parseInt(text.slice(place, place + 2), 16));

// 256 colours, interpolated between the evenly spaced ones of a scale.
function colourTable(names) {
  const stops = names.map(rgbOf);
  return Array.from({ length: 256 }, (_, k) => {
    const place = (k / 255) * (stops.length - 1);
    const below = Math.min(Math.floor(place), stops.length - 2);
    return stops[below].map((start, channel) => Math.round(start + (place - below) * (stops[below + 1][channel] - start)));
  });
}

const TABLES = { sequential: colourTable(run.palette.sequential), diverging: colourTable(run.palette.diverging) };
const NO_ANSWER_COLOUR = rgbOf(run.palette.no_answer);

const isError = (name) => name === ERROR || name === FIRST_PHASOR_ERROR;
const isDepth = (name) => name === FIRST_PHASOR || name === TRUTH || name.endsWith(".depth");

// Layers that are compared share a range of colours.
function rangeKey(name) {
  if (isError(name)) return ERROR;
  return name === FIRST_PHASOR || name === TRUTH ? DIRECT : name;
}

const coloursOf = (name) => (isError(name) ? TABLES.diverging : TABLES.sequential);

function quantile(values, share) {
  const known = values.filter(Number.isFinite).sort();
  return known.length ? known[Math.min(known.length - 1, Math.floor(share * known.length))] : NaN;
}

const chosenRanges = new Map();
const startRanges = new Map();

// The range of a layer's colours before anybody drags its ends, and how far they can be dragged. All frames of the run share it.
function startRange(name) {
  const key = rangeKey(name);
  if (!startRanges.has(key)) startRanges.set(key, isError(name) ? errorRange() : layerRange(key));
  return startRanges.get(key);
}

// Limits that are wide enough for all layers that share a range of colours.
function limitsOf(key) {
  const known = Object.entries(run.limits).filter(([name]) => rangeKey(name) === key).map(([, limits]) => limits);
  if (!known.length) return [0, 1, 0, 1];
  return [Math.min, Math.max, Math.min, Math.max].map((widest, k) => widest(...known.map((limits) => limits[k])));
}

function layerRange(key) {
  let [low, high, lowest, highest] = limitsOf(key);
  if (!(high > low)) [low, high] = [low - 0.5 * Math.max(Math.abs(low), 1e-3), high + 0.5 * Math.max(Math.abs(high), 1e-3)];
  const width = high - low;
  return { low, high, lowest: Math.min(low, Math.max(lowest, low - width)), highest: Math.max(high, Math.min(highest, high + width)) };
}

// Errors of both signs get as many colours.
function errorRange() {
  const [low, high] = limitsOf(ERROR);
  const most = Math.max(1e-3, Math.abs(low), Math.abs(high));
  return { low: -most, high: most, lowest: -2 * most, highest: 2 * most };
}

const rangeOf = (name) => chosenRanges.get(rangeKey(name)) ?? startRange(name);

function colourOf(value, range, table) {
  if (Number.isNaN(value)) return NO_ANSWER_COLOUR;
  const place = Math.round((255 * (value - range.low)) / (range.high - range.low));
  return table[Math.max(0, Math.min(255, place))];
}

function shownNumber(value, unit) {
  if (value === undefined) return "–";
  if (Number.isNaN(value)) return "no answer";
  if (!Number.isFinite(value)) return "∞";
  const size = Math.abs(value);
  const small = (unit === "m" || unit === "V") && size > 0 && size < 0.1;
  const scaled = small ? 1000 * value : value;
  const digits = Math.abs(scaled) >= 1e5 || (scaled && Math.abs(scaled) < 1e-4) ? scaled.toExponential(3) : scaled.toFixed(decimals(scaled));
  return `${digits.replace("-", "−")} ${small ? "m" : ""}${unit}`.trim();
}

// How many digits stand behind the point, so that there are five in all: four at most.
const decimals = (value) => Math.max(0, Math.min(4, 4 - Math.floor(Math.log10(Math.max(Math.abs(value), 1)))));

function wordsOf(status) {
  const words = run.bits.filter((bit) => (status & bit.value) !== 0).map((bit) => bit.name);
  return words.length ? words.join(", ") : "–";
}
