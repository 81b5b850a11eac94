// The panels beside the map: the layers of a pixel, the status bits, the choice of a layer.

function element(tag, properties, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

const row = (name, value) => element("tr", {}, element("th", { scope: "row", textContent: name }), element("td", { className: "number", textContent: value }));

function showReadout(frame, [i, j]) {
  const place = j * frame.columns + i;
  const rows = [...frame.layers.values()].map((layer) => {
    const value = layer.values[place];
    return row(layer.name, layer.name === STATUS ? wordsOf(value) : shownNumber(value, layer.unit));
  });
  byId("readout").tBodies[0].replaceChildren(...rows);
  byId("readout-title").textContent = `Pixel ${frame.x0 + i * frame.step}, ${frame.y0 + j * frame.step}`;
}

// For screen readers: what a key has changed.
const say = (words) => (byId("said").textContent = words);

// For screen readers: the pixel, and its value in the layer that is shown.
function sayPixel(frame, [i, j], name) {
  const layer = frame.layers.get(name);
  const value = shownNumber(layer.values[j * frame.columns + i], layer.unit);
  say(`Column ${frame.x0 + i * frame.step}, row ${frame.y0 + j * frame.step}: ${name} ${value}`);
}

function showOptions(select, names, chosen) {
  select.replaceChildren(...names.map((name) => element("option", { value: name, textContent: name })));
  select.value = names.includes(chosen) ? chosen : names[0];
  return select.value;
}

function swatch(colour) {
  const key = svgElement("svg", { width: 14, height: 14, "aria-hidden": "true" });
  key.append(svgElement("rect", { width: 14, height: 14, rx: 3, fill: colour, stroke: "currentColor", "stroke-opacity": 0.4 }));
  return key;
}

function shareText(count, total) {
  return count && count < total / 1000 ? "< 0.1 %" : `${((100 * count) / total).toFixed(1)} %`;
}

// A check box for each status bit that occurs in the frame, with its share of the pixels; and the share of the layer's grey pixels.
function showOverlays(frame, name, chosen, changed) {
  const status = frame.layers.get(STATUS);
  const counts = run.bits.map((bit) => (status ? status.values.reduce((sum, one) => sum + ((one & bit.value) !== 0), 0) : 0));
  const labels = run.bits.flatMap((bit, k) => {
    if (!counts[k]) return [];
    const box = element("input", { type: "checkbox", checked: chosen.has(bit.value), value: String(bit.value) });
    box.addEventListener("change", () => {
      if (box.checked) chosen.add(bit.value);
      else chosen.delete(bit.value);
      changed();
    });
    const share = element("span", { className: "number", textContent: shareText(counts[k], status.values.length) });
    return [element("label", { title: bit.meaning }, box, swatch(bit.colour), bit.name, share)];
  });
  const { values } = frame.layers.get(name);
  const none = values.reduce((sum, one) => sum + Number.isNaN(one), 0);
  labels.push(element("label", {}, swatch(run.palette.no_answer), "no answer", element("span", { className: "number", textContent: shareText(none, values.length) })));
  byId("overlays").replaceChildren(element("legend", { textContent: "Status bits over the map" }), ...labels);
}

function showSampling(frame) {
  const every = { 2: "second", 3: "third" }[frame.step] ?? `${frame.step}th`;
  byId("sampling").textContent = frame.step === 1 ? "" :
    `Of this frame, the page holds every ${every} row and column, ${frame.columns} × ${frame.rows} of ${frame.width} × ${frame.height} pixels.`;
}

function showProfileTable(frame, profile) {
  const head = ["column", "row", ...profile.series.flatMap((one, k) => (k === 0 && profile.sigma ? [`${one.name}, ${one.unit}`, "sigma, m"] : [`${one.name}${one.unit && `, ${one.unit}`}`]))];
  const exact = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(6))) : "–");
  const rows = profile.samples.map(([i, j], k) => {
    const values = profile.series.flatMap((one, place) => (place === 0 && profile.sigma ? [one.values[k], profile.sigma[k]] : [one.values[k]]));
    const cells = [frame.x0 + i * frame.step, frame.y0 + j * frame.step, ...values.map(exact)];
    return element("tr", {}, ...cells.map((one) => element("td", { className: "number", textContent: one })));
  });
  const titles = head.map((title) => element("th", { scope: "col", className: "number", textContent: title }));
  byId("profile-table").querySelector("table").replaceChildren(element("thead", {}, element("tr", {}, ...titles)), element("tbody", {}, ...rows));
}
