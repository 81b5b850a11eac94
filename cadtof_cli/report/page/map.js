// The map: a layer in colours, the first phasor beside it, status bits over it, the chosen pixel and the chosen line.

const OVERLAY_SHARE = 0.75;

const mapCanvas = byId("map");

function statusColours(frame, bits) {
  const layer = frame.layers.get(STATUS);
  if (!layer || !bits.length) return null;
  const known = new Map();
  return (place) => {
    const status = layer.values[place];
    if (!known.has(status)) known.set(status, bits.find((bit) => (status & bit.value) !== 0)?.rgb ?? null);
    return known.get(status);
  };
}

// The image of a layer. Left of column `split`, it shows the other layer.
function mapImage(frame, name, { otherName, split, bits }) {
  const layer = frame.layers.get(name);
  const other = otherName ? frame.layers.get(otherName) : null;
  const range = rangeOf(name);
  const table = coloursOf(name);
  const over = statusColours(frame, bits);
  const image = new ImageData(frame.columns, frame.rows);
  const paint = (place, [red, green, blue]) => image.data.set([red, green, blue, 255], 4 * place);
  for (let place = 0; place < frame.columns * frame.rows; place += 1) {
    const values = other && place % frame.columns < split ? other.values : layer.values;
    const colour = colourOf(values[place], range, table);
    const bit = over ? over(place) : null;
    paint(place, bit ? colour.map((one, k) => one + OVERLAY_SHARE * (bit[k] - one)) : colour);
  }
  return image;
}

function drawMap(frame, state) {
  const split = state.compare ? Math.round((state.split / 100) * frame.columns) : 0;
  const otherName = state.compare ? (isError(state.layer) ? FIRST_PHASOR_ERROR : FIRST_PHASOR) : null;
  const image = mapImage(frame, state.layer, { otherName, split, bits: run.bits.filter((bit) => state.bits.has(bit.value)) });
  const small = new OffscreenCanvas(frame.columns, frame.rows);
  small.getContext("2d").putImageData(image, 0, 0);
  mapCanvas.parentElement.style.maxWidth = `calc(82vh * ${frame.columns / frame.rows})`;
  mapCanvas.style.aspectRatio = `${frame.columns} / ${frame.rows}`;
  const scale = Math.max(1, Math.ceil((mapCanvas.clientWidth * devicePixelRatio) / frame.columns));
  mapCanvas.width = frame.columns * scale;
  mapCanvas.height = frame.rows * scale;
  const context = mapCanvas.getContext("2d");
  context.imageSmoothingEnabled = false;
  context.drawImage(small, 0, 0, mapCanvas.width, mapCanvas.height);
  const width = Math.max(2, mapCanvas.width / mapCanvas.clientWidth);
  if (state.compare) strokeTwice(context, width, [[split * scale, 0], [split * scale, mapCanvas.height]]);
  if (state.line) strokeTwice(context, width, state.line.map(([i, j]) => [(i + 0.5) * scale, (j + 0.5) * scale]));
  if (state.pixel) markPixel(context, width, state.pixel, scale);
}

// A white line on a wider black one, so that it can be seen on any colour.
function strokeTwice(context, width, points) {
  for (const [style, wide] of [["#000", 3 * width], ["#fff", width]]) {
    context.strokeStyle = style;
    context.lineWidth = wide;
    context.beginPath();
    points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
  }
}

function markPixel(context, width, [i, j], scale) {
  const [x, y] = [(i + 0.5) * scale, (j + 0.5) * scale];
  const [inner, outer] = [0.5 * scale + 2 * width, 0.5 * scale + 8 * width];
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    strokeTwice(context, width, [[x + inner * dx, y + inner * dy], [x + outer * dx, y + outer * dy]]);
  }
}

// The sample under a pointer.
function sampleAt(event, frame) {
  const box = mapCanvas.getBoundingClientRect();
  const within = (share, count) => Math.max(0, Math.min(count - 1, Math.floor(share * count)));
  return [within((event.clientX - box.left) / box.width, frame.columns), within((event.clientY - box.top) / box.height, frame.rows)];
}
