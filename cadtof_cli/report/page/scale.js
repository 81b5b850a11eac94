// The bar of colours, whose ends can be dragged.

const scaleBox = byId("scale");
const handles = { low: byId("scale-low"), high: byId("scale-high") };
const LEAST_WIDTH = 1e-4;

function drawScale(frame, name) {
  const { lowest, highest } = startRange(name);
  const range = rangeOf(name);
  const unit = frame.layers.get(name).unit;
  const canvas = byId("scale-bar");
  canvas.width = 512;
  canvas.height = 1;
  const image = new ImageData(512, 1);
  for (let k = 0; k < 512; k += 1) {
    const colour = colourOf(lowest + (k / 511) * (highest - lowest), range, coloursOf(name));
    image.data.set([...colour, 255], 4 * k);
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
  for (const end of ["low", "high"]) {
    const shown = shownNumber(range[end], unit);
    handles[end].style.left = `${(100 * (range[end] - lowest)) / (highest - lowest)}%`;
    handles[end].setAttribute("aria-valuemin", lowest);
    handles[end].setAttribute("aria-valuemax", highest);
    handles[end].setAttribute("aria-valuenow", range[end]);
    handles[end].setAttribute("aria-valuetext", shown);
    byId(`${end}-text`).textContent = shown;
  }
}

// Move one end of the colours. It stops a little before the other end.
function moveEnd(name, end, value) {
  const { lowest, highest } = startRange(name);
  const range = { ...rangeOf(name) };
  const least = LEAST_WIDTH * (highest - lowest);
  const [from, to] = end === "low" ? [lowest, range.high - least] : [range.low + least, highest];
  range[end] = Math.max(from, Math.min(to, value));
  chosenRanges.set(rangeKey(name), range);
}

// Fit the colours to the values of one frame. Before, they suit the values of all frames of the run.
function fitToFrame(frame, name) {
  const { values } = frame.layers.get(name);
  const ends = isError(name) ? [-1, 1].map((sign) => sign * quantile(values.map(Math.abs), 0.98)) : [0.005, 0.995].map((share) => quantile(values, share));
  if (Number.isNaN(ends[0])) return;
  chosenRanges.delete(rangeKey(name));
  moveEnd(name, "low", ends[0]);
  moveEnd(name, "high", ends[1]);
}

function onScale(shown, changed) {
  for (const end of ["low", "high"]) {
    const handle = handles[end];
    const move = (value) => {
      const { layer } = shown();
      moveEnd(layer, end, value(startRange(layer), rangeOf(layer)));
      changed();
    };
    handle.addEventListener("pointerdown", (event) => handle.setPointerCapture(event.pointerId));
    handle.addEventListener("pointermove", (event) => {
      if (!handle.hasPointerCapture(event.pointerId)) return;
      const box = scaleBox.getBoundingClientRect();
      const share = (event.clientX - box.left) / box.width;
      move(({ lowest, highest }) => lowest + share * (highest - lowest));
    });
    handle.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
      if (steps === undefined && event.key !== "Home" && event.key !== "End") return;
      event.preventDefault();
      if (event.key === "Home") move(({ lowest }) => lowest);
      else if (event.key === "End") move(({ highest }) => highest);
      else move(({ lowest, highest }, range) => range[end] + (steps * (highest - lowest)) / 100);
    });
  }
  byId("scale-fit").addEventListener("click", () => {
    const { frame, layer } = shown();
    fitToFrame(frame, layer);
    changed();
  });
  byId("scale-reset").addEventListener("click", () => {
    chosenRanges.delete(rangeKey(shown().layer));
    changed();
  });
}
