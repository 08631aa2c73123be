// The plan view: north up, east right, equal scales; zoomed, panned, hovered over.

const ZOOM_STEP = 1.3;
const MARGIN_PX = 24;

// Which part of the plan a surface shows: its centre (n, e) in m, and pixels for a metre.
class View {
  constructor(surface) {
    this.surface = surface;
    this.centre = [0, 0];
    this.scale = 1;
  }

  toScreen(n, e) {
    return [
      this.surface.width / 2 + (e - this.centre[1]) * this.scale,
      this.surface.height / 2 - (n - this.centre[0]) * this.scale,
    ];
  }

  toPlan(x, y) {
    return [
      this.centre[0] - (y - this.surface.height / 2) / this.scale,
      this.centre[1] + (x - this.surface.width / 2) / this.scale,
    ];
  }

  fit([lowN, lowE], [highN, highE]) {
    const width = this.surface.width - 2 * MARGIN_PX, height = this.surface.height - 2 * MARGIN_PX;
    this.centre = [(lowN + highN) / 2, (lowE + highE) / 2];
    this.scale = Math.min(width / Math.max(highE - lowE, 1), height / Math.max(highN - lowN, 1));
  }

  // Zoom so that what is under a place on the screen stays there.
  zoom(factor, x = this.surface.width / 2, y = this.surface.height / 2) {
    const [n, e] = this.toPlan(x, y);
    this.scale = Math.min(2000, Math.max(1e-3, this.scale * factor));
    const [newN, newE] = this.toPlan(x, y);
    this.centre = [this.centre[0] + n - newN, this.centre[1] + e - newE];
  }

  pan(right, down) {
    this.centre = [this.centre[0] + down / this.scale, this.centre[1] - right / this.scale];
  }
}

class Plan {
  #dragged = null;

  constructor(box, toggles, plan, colours, state) {
    this.box = box;
    this.state = state;
    this.bounds = boundsOf(plan);
    this.layers = planLayers(plan, colours, state);
    this.surface = new LayeredCanvas(box, (c) => this.#drawBase(c), (c) => this.#drawOverlay(c));
    this.view = new View(this.surface);
    this.tip = element("div", { class: "tip", hidden: "" });
    box.append(this.tip);
    toggles.append(...this.layers.map((layer) => this.#toggle(layer)));
    this.#listen();
    for (const observed of [state.cursor, state.hovered, state.loop]) {
      observed.watch(() => this.surface.schedule("overlay"));
    }
    this.fit();
  }

  fit() {
    this.view.fit(...this.bounds);
    this.surface.redraw();
  }

  zoom(factor, place = []) {
    this.view.zoom(factor, ...place);
    this.surface.redraw();
  }

  #toggle(layer) {
    const box = element("input", { type: "checkbox", "data-layer": layer.key });
    box.checked = layer.visible;
    const mark = element("canvas", { class: "mark", width: 44, height: 24 });
    const paintMark = () => drawMark(mark, layer);
    paintMark();
    darkScheme.addEventListener("change", paintMark);
    box.addEventListener("change", () => {
      layer.visible = box.checked;
      this.surface.redraw();
    });
    return element("label", {}, box, mark, layer.label);
  }

  get #visible() {
    return this.layers.filter((layer) => layer.visible);
  }

  #drawBase(context) {
    this.#drawGrid(context);
    for (const layer of this.#visible) layer.draw(context, this.view);
  }

  #drawOverlay(context) {
    for (const layer of this.#visible) layer.overlay?.(context, this.view);
  }

  #drawGrid(context) {
    const { view } = this, { width, height } = this.surface;
    const [highN, lowE] = view.toPlan(0, 0);
    const [lowN, highE] = view.toPlan(width, height);
    const { step, digits } = ticks(lowE, highE, width / 90);
    const lines = (low, high) => ticks(low, high, (high - low) / step).values;
    context.strokeStyle = themed("grid");
    context.fillStyle = themed("muted");
    context.lineWidth = 1;
    context.beginPath();
    for (const e of lines(lowE, highE)) {
      const [x] = view.toScreen(0, e);
      context.moveTo(x, 0);
      context.lineTo(x, height);
      const label = figure(e, digits);
      const fits = x + 3 + context.measureText(label).width <= width;
      if (fits) context.fillText(label, x + 3, height - 5);
    }
    for (const n of lines(lowN, highN)) {
      const [, y] = view.toScreen(n, 0);
      context.moveTo(0, y);
      context.lineTo(width, y);
      // the corners hold the name of the axis, and the figures of the other one
      if (y > 30 && y < height - 18) context.fillText(figure(n, digits), 4, y - 3);
    }
    context.stroke();
    context.fillText("east, m", width / 2, height - 18);
    context.fillText("north, m", 4, 14);
  }

  #listen() {
    const { box } = this;
    box.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      this.#dragged = { place: placeIn(box, event), moved: false };
      box.setPointerCapture(event.pointerId);
    });
    box.addEventListener("pointermove", (event) => this.#moved(placeIn(box, event)));
    box.addEventListener("pointerup", (event) => {
      if (this.#dragged && !this.#dragged.moved) this.#clicked(placeIn(box, event));
      this.#dragged = null;
    });
    box.addEventListener("pointerleave", () => this.#hover(undefined));
    box.addEventListener("dblclick", () => this.fit());
    // the wheel scrolls the page until the plan has been clicked
    box.addEventListener("wheel", (event) => {
      if (document.activeElement !== box && !event.ctrlKey) return;
      event.preventDefault();
      this.zoom(Math.exp(-0.0015 * event.deltaY * (event.deltaMode ? 30 : 1)), placeIn(box, event));
    }, { passive: false });
    box.addEventListener("keydown", (event) => this.#key(event));
  }

  #key(event) {
    const far = 60;
    const moves = {
      ArrowLeft: [far, 0], ArrowRight: [-far, 0], ArrowUp: [0, far], ArrowDown: [0, -far],
    };
    if (event.key in moves) this.view.pan(...moves[event.key]);
    else if (event.key === "+" || event.key === "=") this.view.zoom(ZOOM_STEP);
    else if (event.key === "-") this.view.zoom(1 / ZOOM_STEP);
    else if (event.key === "0") this.view.fit(...this.bounds);
    else return;
    event.preventDefault();
    this.surface.redraw();
  }

  #moved(place) {
    const drag = this.#dragged;
    if (!drag) {
      this.#hover(this.#pick(place), place);
      return;
    }
    const [right, down] = [place[0] - drag.place[0], place[1] - drag.place[1]];
    if (!drag.moved && Math.hypot(right, down) < 4) return;
    this.#dragged = { place, moved: true };
    this.view.pan(right, down);
    this.surface.redraw();
  }

  // The nearest of what the visible layers have there; what has a name before mere paths.
  #pick(place) {
    const found = this.#visible.map((layer) => layer.pick?.(place, this.view)).filter(Boolean);
    found.sort((a, b) => Boolean(b.lines) - Boolean(a.lines) || a.distance - b.distance);
    return found[0];
  }

  #hover(found, place) {
    this.state.hovered.set(found?.loop ?? null);
    if (found?.time !== undefined) this.state.cursor.set(found.time);
    this.tip.hidden = !found?.lines;
    this.box.style.cursor = found?.loop ? "pointer" : "";
    if (!found?.lines) return;
    this.tip.replaceChildren(...found.lines.map((line) => element("div", {}, line)));
    const [x, y] = place;
    const [width, height] = [this.tip.offsetWidth, this.tip.offsetHeight];
    this.tip.style.left = `${x + 14 + width > this.surface.width ? x - width - 14 : x + 14}px`;
    this.tip.style.top = `${Math.max(4, Math.min(y + 12, this.surface.height - height - 4))}px`;
  }

  #clicked(place) {
    const found = this.#pick(place);
    if (found?.loop) this.state.loop.set(found.loop);
  }
}

// South-west and north-east corners of what is drawn; stray echoes don't count.
function boundsOf(plan) {
  const paths = [...plan.tracks, plan.reference, plan.map && withoutStrays(plan.map)];
  const places = [...plan.survey, ...plan.tracks.flatMap((track) => track.landmarks)];
  const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
  const include = (n, e) => {
    low[0] = Math.min(low[0], n);
    low[1] = Math.min(low[1], e);
    high[0] = Math.max(high[0], n);
    high[1] = Math.max(high[1], e);
  };
  for (const path of paths) {
    if (path) path.n.forEach((n, k) => include(n, path.e[k]));
  }
  for (const { ne } of places) include(...ne);
  return [low, high];
}

// The corners between which all but a few of a cloud's points lie.
function withoutStrays(cloud) {
  const between = (values) => {
    const sorted = Float64Array.from(values).sort();
    return [0.005, 0.995].map((share) => sorted[Math.floor(share * (sorted.length - 1))]);
  };
  return { n: between(cloud.n), e: between(cloud.e) };
}

// A layer's mark beside its name.
function drawMark(canvas, layer) {
  const context = canvas.getContext("2d");
  context.setTransform(2, 0, 0, 2, 0, 0);
  context.clearRect(0, 0, 22, 12);
  context.strokeStyle = context.fillStyle = layer.colour();
  context.lineWidth = 2;
  context.setLineDash(layer.mark === "dashes" ? [4, 3] : []);
  if (layer.mark === "cross") strokeCross(context, 11, 6, 4);
  else if (layer.mark === "plus") strokePlus(context, 11, 6, 5);
  else if (layer.mark === "square") context.strokeRect(7, 2, 8, 8);
  else if (layer.mark === "dots") {
    for (const [x, y] of [[5, 8], [10, 4], [15, 7]]) context.fillRect(x, y, 2.4, 2.4);
  } else {
    context.beginPath();
    context.moveTo(1, 6);
    context.lineTo(21, 6);
    context.stroke();
  }
}
