// The state of the viewer, and how it changes by pointer and keys.

for (const bit of run.bits) bit.rgb = rgbOf(bit.colour);

const state = { number: 0, layer: DIRECT, compare: false, split: 50, bits: new Set(), pixel: null, line: null, begun: null, view: START_VIEW, cloudLayer: DIRECT };
let frame = null;
let profile = null;
let points = null;

const thumbnails = [...document.querySelectorAll("#strip button")];

let waiting = false;
function redraw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    drawAll();
  });
}

function drawAll() {
  const hasPhasor = frame.layers.has(isError(state.layer) ? FIRST_PHASOR_ERROR : FIRST_PHASOR) && (isDepth(state.layer) || isError(state.layer));
  byId("compare-label").hidden = !hasPhasor;
  const compare = state.compare && hasPhasor;
  byId("split").hidden = byId("compare-marks").hidden = !compare;
  mapCanvas.setAttribute("aria-label", `Map of ${state.layer}, ${frame.name}, ${frame.columns} × ${frame.rows} pixels`);
  byId("compare-marks").lastElementChild.textContent = state.layer === DIRECT || state.layer === ERROR ? "resolved" : state.layer;
  drawMap(frame, { ...state, compare });
  drawScale(frame, state.layer);
  drawPoints();
}

function drawPoints() {
  if (points) drawCloud(frame, points, state.layer, state.view);
}

function setPoints() {
  const depths = [...frame.layers.keys()].filter(isDepth);
  byId("points").hidden = !depths.length;
  if (!depths.length) return;
  state.cloudLayer = showOptions(byId("cloud-layer"), depths, state.cloudLayer);
  const note = byId("cloud-note");
  note.hidden = Boolean(frame.optics);
  note.textContent = "The optics are not known, so the points cannot be computed: write the page with --focal-length-px, and for maps of a --roi also with --principal-point-px.";
  cloudCanvas.hidden = !frame.optics;
  cloudCanvas.setAttribute("aria-label", `Points of ${state.cloudLayer}, ${frame.name}`);
  points = frame.optics ? pointsOf(frame, state.cloudLayer) : null;
}

function setProfile(line) {
  state.line = line;
  profile = profileOf(frame, state.layer, line);
  drawProfile(profile, frame);
  if (byId("profile-table").open) showProfileTable(frame, profile);
}

function setPixel(pixel, { aloud = false } = {}) {
  state.pixel = pixel;
  showReadout(frame, pixel);
  if (aloud) sayPixel(frame, pixel, state.layer);
}

function setLayer(name) {
  state.layer = name;
  showOverlays(frame, name, state.bits, redraw);
  if (state.line) setProfile(state.line);
  redraw();
}

const clamped = ([i, j]) => [Math.max(0, Math.min(frame.columns - 1, i)), Math.max(0, Math.min(frame.rows - 1, j))];

// The same pixel in another frame, of which the page may hold more or fewer pixels.
function moved([i, j], from) {
  const [x, y] = [from.x0 + i * from.step, from.y0 + j * from.step];
  return clamped([Math.round((x - frame.x0) / frame.step), Math.round((y - frame.y0) / frame.step)]);
}

async function showFrame(number) {
  state.number = number;
  const next = await frameOf(number);
  if (state.number !== number) return;
  const before = frame;
  frame = next;
  byId("frame-name").textContent = `${frame.name}  (${number + 1} of ${run.frames.length})`;
  // a button that is `disabled` would lose the focus
  byId("previous").setAttribute("aria-disabled", String(number === 0));
  byId("next").setAttribute("aria-disabled", String(number === run.frames.length - 1));
  thumbnails.forEach((one) => {
    const chosen = Number(one.dataset.frame) === number;
    one.setAttribute("aria-pressed", String(chosen));
    // one stop of the Tab key for all thumbnails; arrows go from one to the next
    one.tabIndex = chosen ? 0 : -1;
  });
  state.layer = showOptions(byId("layer"), [...frame.layers.keys()].filter((name) => name !== STATUS), state.layer);
  const middle = [Math.floor(frame.columns / 2), Math.floor(frame.rows / 2)];
  setPixel(before && state.pixel ? moved(state.pixel, before) : middle);
  state.begun &&= moved(state.begun, before);
  setProfile(before && state.line ? state.line.map((end) => moved(end, before)) : rowLine(middle));
  showOverlays(frame, state.layer, state.bits, redraw);
  showSampling(frame);
  setPoints();
  if (before) say(byId("frame-name").textContent);
  redraw();
}

const rowLine = ([, j]) => [[0, j], [frame.columns - 1, j]];
const columnLine = ([i]) => [[i, 0], [i, frame.rows - 1]];

function step(by) {
  const number = Math.max(0, Math.min(run.frames.length - 1, state.number + by));
  if (number === state.number) return;
  showFrame(number);
  const shown = thumbnails.find((one) => Number(one.dataset.frame) === number);
  const strip = byId("strip");
  if (shown) strip.scrollLeft = shown.offsetLeft - strip.offsetLeft - (strip.clientWidth - shown.clientWidth) / 2;
}

function onMap() {
  let held = null;
  mapCanvas.addEventListener("pointerdown", (event) => {
    held = sampleAt(event, frame);
    mapCanvas.setPointerCapture(event.pointerId);
    setPixel(held);
    redraw();
  });
  mapCanvas.addEventListener("pointermove", (event) => {
    const at = sampleAt(event, frame);
    setPixel(at);
    if (held && (at[0] !== held[0] || at[1] !== held[1])) setProfile([held, at]);
    redraw();
  });
  for (const end of ["pointerup", "pointercancel"]) mapCanvas.addEventListener(end, () => (held = null));
  mapCanvas.addEventListener("keydown", onMapKey);
}

function onMapKey(event) {
  const by = event.shiftKey ? 10 : 1;
  const [i, j] = state.pixel;
  const to = { ArrowLeft: [i - by, j], ArrowRight: [i + by, j], ArrowUp: [i, j - by], ArrowDown: [i, j + by] }[event.key];
  const key = event.key.toLowerCase();
  if (to) {
    setPixel(clamped(to), { aloud: true });
    if (state.begun) setProfile([state.begun, state.pixel]);
  } else if (key === "enter") {
    state.begun = state.begun ? null : state.pixel;
    say(state.begun ? "The line begins here" : byId("profile-title").textContent);
  } else if (key === "escape") {
    state.begun = null;
  } else if (key === "r" && !event.ctrlKey && !event.metaKey) {
    setProfile(rowLine(state.pixel));
    say(byId("profile-title").textContent);
  } else if (key === "c" && !event.ctrlKey && !event.metaKey) {
    setProfile(columnLine(state.pixel));
    say(byId("profile-title").textContent);
  } else if (key === "pageup") {
    step(-1);
  } else if (key === "pagedown") {
    step(1);
  } else return;
  event.preventDefault();
  redraw();
}

function onStrip() {
  thumbnails.forEach((button, place) => {
    button.addEventListener("click", () => showFrame(Number(button.dataset.frame)));
    button.addEventListener("keydown", (event) => {
      const to = { ArrowLeft: place - 1, ArrowRight: place + 1, Home: 0, End: thumbnails.length - 1 }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      thumbnails[Math.max(0, Math.min(thumbnails.length - 1, to))].focus();
    });
  });
  byId("previous").addEventListener("click", () => step(-1));
  byId("next").addEventListener("click", () => step(1));
}

function onProfile() {
  profileSvg.addEventListener("pointermove", (event) => {
    const place = profilePlace(event, profile);
    const texts = profile.series.map((one) => `${one.name} ${shownNumber(one.values[place], one.unit)}`);
    if (profile.sigma) texts.splice(1, 0, `± ${shownNumber(profile.sigma[place], "m")}`);
    byId("profile-at").textContent = texts.join(" · ");
    setPixel(profile.samples[place]);
    redraw();
  });
  byId("profile-table").addEventListener("toggle", () => byId("profile-table").open && showProfileTable(frame, profile));
  byId("row-profile").addEventListener("click", () => { setProfile(rowLine(state.pixel)); redraw(); });
  byId("column-profile").addEventListener("click", () => { setProfile(columnLine(state.pixel)); redraw(); });
}

function onChoices() {
  byId("layer").addEventListener("change", (event) => setLayer(event.target.value));
  byId("compare").addEventListener("change", (event) => { state.compare = event.target.checked; redraw(); });
  byId("split").addEventListener("input", (event) => { state.split = Number(event.target.value); redraw(); });
  byId("cloud-layer").addEventListener("change", (event) => { state.cloudLayer = event.target.value; setPoints(); redraw(); });
  onScale(() => ({ frame, layer: state.layer }), redraw);
  onCloud(() => state.view, (view) => { state.view = view; requestAnimationFrame(drawPoints); });
}

function onPage() {
  const again = () => { if (frame) { drawProfile(profile, frame); redraw(); } };
  new ResizeObserver(again).observe(byId("viewer"));
  addEventListener("beforeprint", () => { if (frame) { drawProfile(profile, frame); drawAll(); } });
  addEventListener("afterprint", again);
}

async function start() {
  onStrip();
  if (!run.frames.length) return;
  if (!("DecompressionStream" in window) || !("OffscreenCanvas" in window)) {
    byId("too-old").hidden = false;
    return;
  }
  byId("skip").hidden = byId("viewer").hidden = byId("points").hidden = false;
  await showFrame(0);
  onMap();
  onProfile();
  onChoices();
  onPage();
  drawAll();
  document.documentElement.dataset.ready = String(Math.round(performance.now()));
}

start();
