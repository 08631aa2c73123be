// What all views share: elements, observed values, colours of the scheme, layered canvases, ticks.

// An element with attributes and children; text stays text.
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// A value that others are told of when it changes.
class Observed {
  #watchers = [];

  constructor(value) {
    this.value = value;
  }

  set(value) {
    this.value = value;
    for (const tell of this.#watchers) tell(value);
  }

  watch(tell) {
    this.#watchers.push(tell);
  }
}

const darkScheme = matchMedia("(prefers-color-scheme: dark)");

// A colour of the style sheet.
function themed(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

// A method's colour; on dark ground it is mixed with white to stand out as well.
function onGround(colour) {
  if (!darkScheme.matches) return colour;
  const parts = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
  return `rgb(${parts.map((part) => Math.round(part + 0.4 * (255 - part))).join(" ")})`;
}

function figure(value, digits) {
  if (value === null || !Number.isFinite(value)) return "–";
  // what rounds to zero has no sign
  const shown = Math.abs(value) < 0.5 * 10 ** -digits ? 0 : value;
  return shown.toFixed(digits).replace("-", "−");
}

// Round numbers between two limits, about a step of so many apart, and how many decimals they have.
function ticks(low, high, wanted) {
  const rough = (high - low) / Math.max(wanted, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999);
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  const values = Array.from({ length: Math.max(count, 0) }, (_, k) => (first + k) * step);
  return { values, step, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

// Two canvases, one over the other, as large as their box: what costs time, and what moves.
class LayeredCanvas {
  #scheduled = { base: false, overlay: false };

  constructor(box, drawBase, drawOverlay) {
    this.box = box;
    this.draw = { base: drawBase, overlay: drawOverlay };
    this.canvas = { base: element("canvas"), overlay: element("canvas") };
    box.append(this.canvas.base, this.canvas.overlay);
    this.#measure();
    new ResizeObserver(() => this.#resize()).observe(box);
    darkScheme.addEventListener("change", () => this.redraw());
  }

  // Kept, as asking the box costs time where it is asked for every point.
  #measure() {
    [this.width, this.height] = [this.box.clientWidth, this.box.clientHeight];
  }

  redraw() {
    this.schedule("base");
    this.schedule("overlay");
  }

  // Draw a layer before the next frame, however often it is asked for.
  schedule(layer) {
    if (this.#scheduled[layer]) return;
    this.#scheduled[layer] = true;
    requestAnimationFrame(() => {
      this.#scheduled[layer] = false;
      this.#paint(layer);
    });
  }

  #resize() {
    this.#measure();
    const density = devicePixelRatio;
    for (const canvas of Object.values(this.canvas)) {
      canvas.width = Math.round(this.width * density);
      canvas.height = Math.round(this.height * density);
    }
    this.#paint("base");
    this.#paint("overlay");
  }

  #paint(layer) {
    const canvas = this.canvas[layer];
    if (!canvas.width || !canvas.height) return;
    const context = canvas.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.setTransform(canvas.width / this.width, 0, 0, canvas.height / this.height, 0, 0);
    context.font = "11px system-ui, sans-serif";
    context.lineJoin = "round";
    this.draw[layer](context);
  }
}

// Where a pointer is inside a box, in its pixels.
function placeIn(box, event) {
  const bounds = box.getBoundingClientRect();
  return [event.clientX - bounds.left, event.clientY - bounds.top];
}
