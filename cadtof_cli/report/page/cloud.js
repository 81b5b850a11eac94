// Points in space, drawn by the CPU: nearer points hide farther ones. Coordinates in m, as in `cadtof export`: x right, y down, z forward.

const cloudCanvas = byId("cloud");
const START_VIEW = { yaw: -0.5, pitch: 0.3, zoom: 1, right: 0, down: 0 };
const CAMERA_DISTANCE = 2.2;
const MOST_DOT = 24;

function pointsOf(frame, name) {
  const { values } = frame.layers.get(name);
  const { focal_length_px: focal, column, row } = frame.optics;
  const points = { x: [], y: [], z: [], place: [] };
  for (let place = 0; place < values.length; place += 1) {
    if (!Number.isFinite(values[place])) continue;
    const right = (frame.x0 + (place % frame.columns) * frame.step - column) / focal;
    const down = (frame.y0 + Math.floor(place / frame.columns) * frame.step - row) / focal;
    const forward = frame.depth === "z" ? values[place] : values[place] / Math.hypot(1, right, down);
    points.x.push(forward * right);
    points.y.push(forward * down);
    points.z.push(forward);
    points.place.push(place);
  }
  return { ...points, ...middleOf(points) };
}

// The point about which the view turns, and the size of the cloud. Stray points do not count.
function middleOf(points) {
  const [low, high] = [0.02, 0.98].map((share) => [points.x, points.y, points.z].map((one) => quantile(Float64Array.from(one), share)));
  return { middle: low.map((one, k) => (one + high[k]) / 2), size: Math.max(1e-3, Math.hypot(...low.map((one, k) => high[k] - one))) };
}

function drawCloud(frame, points, layer, view) {
  const width = Math.max(1, Math.round(cloudCanvas.clientWidth * devicePixelRatio));
  const height = Math.max(1, Math.round(cloudCanvas.clientHeight * devicePixelRatio));
  cloudCanvas.width = width;
  cloudCanvas.height = height;
  const image = new ImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  const nearest = new Float32Array(width * height).fill(Infinity);
  const [colours, range, table] = [frame.layers.get(layer).values, rangeOf(layer), coloursOf(layer)];
  const [cy, sy, cp, sp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
  const scale = (view.zoom * Math.min(width, height) * 1.1) / points.size;
  const spacing = (1.2 * frame.step) / frame.optics.focal_length_px;
  const away = CAMERA_DISTANCE * points.size;
  for (let k = 0; k < points.place.length; k += 1) {
    const [x, y, z] = [points.x[k] - points.middle[0], points.y[k] - points.middle[1], points.z[k] - points.middle[2]];
    const [across, along] = [cy * x + sy * z, cy * z - sy * x];
    const [down, deep] = [cp * y + sp * along, cp * along - sp * y];
    const ratio = away / (away + deep);
    if (!(ratio > 0)) continue;
    const [red, green, blue] = colourOf(colours[points.place[k]], range, table);
    const dot = Math.max(1, Math.min(MOST_DOT, Math.ceil(scale * ratio * spacing * points.z[k])));
    const left = Math.round((0.5 + view.right) * width + scale * ratio * across - dot / 2);
    const top = Math.round((0.5 + view.down) * height + scale * ratio * down - dot / 2);
    for (let v = Math.max(0, top); v < Math.min(height, top + dot); v += 1) {
      for (let u = Math.max(0, left); u < Math.min(width, left + dot); u += 1) {
        if (deep < nearest[v * width + u]) {
          nearest[v * width + u] = deep;
          pixels[v * width + u] = (255 << 24) | (blue << 16) | (green << 8) | red;
        }
      }
    }
  }
  cloudCanvas.getContext("2d").putImageData(image, 0, 0);
}

function turned(view, { key, shiftKey }) {
  const moves = { ArrowLeft: { right: view.right - 0.05 }, ArrowRight: { right: view.right + 0.05 }, ArrowUp: { down: view.down - 0.05 }, ArrowDown: { down: view.down + 0.05 } };
  const changes = {
    ArrowLeft: { yaw: view.yaw - 0.1 },
    ArrowRight: { yaw: view.yaw + 0.1 },
    ArrowUp: { pitch: Math.max(-1.5, view.pitch - 0.1) },
    ArrowDown: { pitch: Math.min(1.5, view.pitch + 0.1) },
    "+": { zoom: Math.min(20, view.zoom * 1.15) },
    "-": { zoom: Math.max(0.2, view.zoom / 1.15) },
    0: START_VIEW,
    ...(shiftKey && moves),
  };
  return changes[key] && { ...view, ...changes[key] };
}

function onCloud(view, changed) {
  const held = new Map();
  const change = (part) => changed({ ...view(), ...part });
  cloudCanvas.addEventListener("pointerdown", (event) => {
    held.set(event.pointerId, event);
    cloudCanvas.setPointerCapture(event.pointerId);
  });
  const release = (event) => held.delete(event.pointerId);
  cloudCanvas.addEventListener("pointerup", release);
  cloudCanvas.addEventListener("pointercancel", release);
  cloudCanvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const box = cloudCanvas.getBoundingClientRect();
    const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
    const { yaw, pitch, zoom, right, down } = view();
    const other = [...held.values()].find((one) => one.pointerId !== event.pointerId);
    held.set(event.pointerId, event);
    if (other) {
      const apart = (one) => Math.max(1, Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY));
      change({ zoom: Math.max(0.2, Math.min(20, (zoom * apart(event)) / apart(before))), right: right + dx / box.width / 2, down: down + dy / box.height / 2 });
    } else if (event.shiftKey) change({ right: right + dx / box.width, down: down + dy / box.height });
    else change({ yaw: yaw + dx / 150, pitch: Math.max(-1.5, Math.min(1.5, pitch + dy / 150)) });
  });
  cloudCanvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    change({ zoom: Math.max(0.2, Math.min(20, view().zoom * Math.exp(-event.deltaY / 300))) });
  }, { passive: false });
  cloudCanvas.addEventListener("keydown", (event) => {
    const next = turned(view(), event);
    if (!next) return;
    event.preventDefault();
    changed(next);
  });
  byId("cloud-reset").addEventListener("click", () => changed(START_VIEW));
}
