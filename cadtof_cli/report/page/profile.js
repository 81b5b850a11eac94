// Values along a line, with the band of one standard deviation.

const profileSvg = byId("profile");
const LINE_KINDS = { [FIRST_PHASOR]: "phasor", [TRUTH]: "truth" };
const MARGIN = { left: 62, right: 12, top: 10, bottom: 44 };

function svgElement(tag, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

// The samples that a line goes through, from its first to its last.
function samplesAlong([[i0, j0], [i1, j1]]) {
  const steps = Math.max(Math.abs(i1 - i0), Math.abs(j1 - j0));
  return Array.from({ length: steps + 1 }, (_, k) => {
    const share = steps ? k / steps : 0;
    return [Math.round(i0 + share * (i1 - i0)), Math.round(j0 + share * (j1 - j0))];
  });
}

// The layers that are shown together: resolved direct depth, first phasor and truth. Any other layer is shown alone.
function profileLayers(frame, name) {
  const names = rangeKey(name) === DIRECT ? [DIRECT, FIRST_PHASOR, TRUTH] : [name];
  return names.map((one) => frame.layers.get(one)).filter(Boolean);
}

function profileOf(frame, name, line) {
  const samples = samplesAlong(line);
  const places = samples.map(([i, j]) => j * frame.columns + i);
  const [first] = samples;
  const distances = samples.map(([i, j]) => frame.step * Math.hypot(i - first[0], j - first[1]));
  const series = profileLayers(frame, name).map((layer) => ({
    kind: LINE_KINDS[layer.name] ?? "own", name: layer.name, unit: layer.unit, values: places.map((place) => layer.values[place]),
  }));
  const sigma = frame.layers.get(series[0].name.replace(/\.depth$/, ".sigma"));
  return { samples, distances, series, sigma: sigma && isDepth(series[0].name) ? places.map((place) => sigma.values[place]) : null };
}

// Ticks at round numbers, about `count` of them.
function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k += 1) found.push(k * step);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

function verticalRange({ series, sigma }) {
  const known = series.flatMap((one) => one.values).filter(Number.isFinite);
  const scatter = sigma ? Math.max(0, ...sigma.filter(Number.isFinite)) : 0;
  if (!known.length) return [0, 1];
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const room = Math.max(0.06 * (high - low), Math.min(scatter, 0.3 * (high - low) + 1e-3), 1e-3 * Math.abs(high), 1e-6);
  return [low - room, high + room];
}

function pathOf(points) {
  let drawn = "";
  let before = false;
  for (const [x, y] of points) {
    const known = Number.isFinite(y);
    if (known) drawn += `${before ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`;
    if (known && !before) drawn += "h.01";
    before = known;
  }
  return drawn;
}

function bandPaths(xs, values, sigma, y) {
  const pieces = [];
  let piece = [];
  xs.forEach((x, k) => {
    if (Number.isFinite(values[k]) && Number.isFinite(sigma[k])) piece.push([x, y(values[k] - sigma[k]), y(values[k] + sigma[k])]);
    else if (piece.length) pieces.push(piece.splice(0));
  });
  if (piece.length) pieces.push(piece);
  const corner = (x, height) => `${x.toFixed(1)} ${height.toFixed(1)}`;
  return pieces.map((one) => `M${one.map(([x, low]) => corner(x, low)).join("L")}L${one.reverse().map(([x, , high]) => corner(x, high)).join("L")}Z`);
}

function drawProfile(profile, frame) {
  const [width, height] = [profileSvg.clientWidth || 600, profileSvg.clientHeight || 270];
  profileSvg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const [low, high] = verticalRange(profile);
  const longest = profile.distances.at(-1) || 1;
  const x = (distance) => MARGIN.left + (distance / longest) * (width - MARGIN.left - MARGIN.right);
  const y = (value) => height - MARGIN.bottom - ((value - low) / (high - low)) * (height - MARGIN.top - MARGIN.bottom);
  const xs = profile.distances.map(x);
  const clip = svgElement("clipPath", { id: "profile-clip" });
  const inside = { x: MARGIN.left, y: MARGIN.top, width: Math.max(1, width - MARGIN.left - MARGIN.right), height: height - MARGIN.top - MARGIN.bottom };
  clip.append(svgElement("rect", inside));
  const drawn = svgElement("g", { "clip-path": "url(#profile-clip)" });
  if (profile.sigma) bandPaths(xs, profile.series[0].values, profile.sigma, y).forEach((path) => drawn.append(svgElement("path", { class: "band", d: path })));
  for (const one of [...profile.series].reverse()) {
    drawn.append(svgElement("path", { class: `line line-${one.kind}`, d: pathOf(one.values.map((value, k) => [xs[k], y(value)])) }));
  }
  profileSvg.replaceChildren(clip, ...axes({ low, high, longest, x, y, width, height, unit: profile.series[0]?.unit ?? "" }), drawn);
  const [from, to] = [profile.samples[0], profile.samples.at(-1)].map(([i, j]) => `${frame.x0 + i * frame.step}, ${frame.y0 + j * frame.step}`);
  byId("profile-title").textContent = `Profile from pixel ${from} to ${to}`;
  drawProfileLegend(profile);
}

function axes({ low, high, longest, x, y, width, height, unit }) {
  const made = [];
  const vertical = ticks(low, high, 5);
  for (const value of vertical.found) {
    made.push(svgElement("line", { class: "grid", x1: MARGIN.left, x2: width - MARGIN.right, y1: y(value), y2: y(value) }));
    made.push(svgElement("text", { x: MARGIN.left - 6, y: y(value) + 4, "text-anchor": "end" }, value.toFixed(vertical.digits).replace("-", "−")));
  }
  for (const value of ticks(0, longest, width > 600 ? 8 : 4).found) {
    made.push(svgElement("text", { x: x(value), y: height - 26, "text-anchor": "middle" }, String(Math.round(10 * value) / 10)));
  }
  made.push(svgElement("text", { x: (MARGIN.left + width - MARGIN.right) / 2, y: height - 8, "text-anchor": "middle" }, "pixels along the line"));
  made.push(svgElement("text", { x: 2, y: height - 26 }, unit ? `in ${unit}` : ""));
  return made;
}

function drawProfileLegend(profile) {
  const entries = profile.series.map((one) => legendEntry(svgElement("path", { class: `line line-${one.kind}`, d: "M0 6h22" }), one.name));
  if (profile.sigma) entries.splice(1, 0, legendEntry(svgElement("rect", { width: 22, height: 12, fill: "var(--direct)", opacity: 0.3 }), "± 1 sigma"));
  byId("profile-legend").replaceChildren(...entries);
}

function legendEntry(mark, title) {
  const key = svgElement("svg", { width: 22, height: 12, "aria-hidden": "true" });
  key.append(mark);
  const entry = document.createElement("li");
  entry.append(key, title);
  return entry;
}

// The place along the line that is nearest to the pointer.
function profilePlace(event, profile) {
  const box = profileSvg.getBoundingClientRect();
  const share = (event.clientX - box.left - MARGIN.left) / (box.width - MARGIN.left - MARGIN.right);
  const wanted = share * (profile.distances.at(-1) || 0);
  const gaps = profile.distances.map((distance) => Math.abs(distance - wanted));
  return gaps.indexOf(Math.min(...gaps));
}
