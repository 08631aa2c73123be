// Charts over time: one cursor and one span for all of them.

const GUTTER = { left: 48, right: 8, top: 6, bottom: 18 };
const LEAST_SPAN_S = 1;

class Chart {
  #selected = null;

  constructor(parent, chart, page, state) {
    this.chart = chart;
    this.page = page;
    this.state = state;
    this.readings = chart.lines.map(() => element("output"));
    const legend = chart.lines.map((line, k) => {
      const dot = element("span", { class: "dot" });
      const paint = () => { dot.style.background = this.#colour(line); };
      paint();
      darkScheme.addEventListener("change", paint);
      return element("span", { class: "entry" }, dot, line.name, " ", this.readings[k]);
    });
    const unit = chart.unit && ` (${chart.unit})`;
    this.box = element("div", { class: "surface" });
    parent.append(element("div", { class: "chart" },
      element("div", { class: "legend" }, element("b", {}, chart.title + unit), ...legend),
      this.box));
    this.surface = new LayeredCanvas(this.box, (c) => this.#drawBase(c), (c) => this.#drawOverlay(c));
    state.cursor.watch(() => this.#follow());
    state.span.watch(() => this.surface.redraw());
    this.#listen();
    this.#follow();
  }

  #colour(line) {
    return line.method ? onGround(this.page.colours[line.method]) : themed("compass");
  }

  #toX(t) {
    const [from, to] = this.state.span.value;
    const width = this.surface.width - GUTTER.left - GUTTER.right;
    return GUTTER.left + ((t - from) / (to - from)) * width;
  }

  #toTime(x) {
    const [from, to] = this.state.span.value;
    const share = (x - GUTTER.left) / (this.surface.width - GUTTER.left - GUTTER.right);
    return from + Math.min(1, Math.max(0, share)) * (to - from);
  }

  #toY(value) {
    const [low, high] = this.limits;
    const height = this.surface.height - GUTTER.top - GUTTER.bottom;
    return GUTTER.top + ((high - value) / (high - low)) * height;
  }

  // Lowest and highest value in the span, with three sigma.
  #limitsInSpan() {
    const [from, to] = this.state.span.value;
    let low = this.chart.from_zero ? 0 : Infinity, high = -Infinity;
    for (const line of this.chart.lines) {
      const end = Math.min(line.t.length, firstAtOrAfter(line.t, to) + 1);
      for (let k = Math.max(0, firstAtOrAfter(line.t, from) - 1); k < end; k++) {
        const [bottom, top] = bandOf(line, k) ?? [line.values[k], line.values[k]];
        low = Math.min(low, line.values[k], bottom);
        high = Math.max(high, line.values[k], top);
      }
    }
    if (!Number.isFinite(high)) return [0, 1];
    const margin = 0.05 * (high - low) || 1;
    return [this.chart.from_zero ? 0 : low - margin, high + margin];
  }

  #drawBase(context) {
    this.limits = this.#limitsInSpan();
    this.#drawAxes(context);
    context.save();
    context.beginPath();
    context.rect(GUTTER.left, 0, this.surface.width - GUTTER.left - GUTTER.right,
      this.surface.height - GUTTER.bottom);
    context.clip();
    this.#shadeUnscored(context);
    for (const line of this.chart.lines) {
      const [from, to] = this.state.span.value;
      const first = Math.max(0, firstAtOrAfter(line.t, from) - 1);
      const end = Math.min(line.t.length, firstAtOrAfter(line.t, to) + 1);
      context.strokeStyle = context.fillStyle = this.#colour(line);
      if (line.three_sigma) this.#fillBand(context, line, first, end);
      if (line.method) this.#strokeLine(context, line, first, end);
      else this.#dotLine(context, line, first, end);
    }
    context.restore();
  }

  #drawAxes(context) {
    const { width, height } = this.surface;
    const vertical = ticks(...this.limits, (height - 24) / 28);
    const horizontal = ticks(...this.state.span.value, width / 90);
    context.strokeStyle = themed("grid");
    context.fillStyle = themed("muted");
    context.lineWidth = 1;
    context.beginPath();
    context.textAlign = "right";
    for (const value of vertical.values) {
      const y = this.#toY(value);
      context.moveTo(GUTTER.left, y);
      context.lineTo(width - GUTTER.right, y);
      context.fillText(figure(value, vertical.digits), GUTTER.left - 5, y + 4);
    }
    context.textAlign = "center";
    for (const value of horizontal.values) {
      const x = this.#toX(value);
      context.moveTo(x, GUTTER.top);
      context.lineTo(x, height - GUTTER.bottom);
      context.fillText(`${figure(value, horizontal.digits)} s`, Math.min(x, width - 30), height - 4);
    }
    context.textAlign = "left";
    context.stroke();
  }

  #shadeUnscored(context) {
    if (!this.page.window_s) return;
    const [from, to] = this.page.window_s.map((t) => this.#toX(t));
    context.fillStyle = themed("unscored");
    context.fillRect(0, 0, from, this.surface.height);
    context.fillRect(to, 0, this.surface.width - to, this.surface.height);
  }

  #strokeLine(context, line, first, end) {
    const starts = new Set(line.starts);
    context.lineWidth = 1.3;
    context.beginPath();
    for (let k = first; k < end; k++) {
      const x = this.#toX(line.t[k]), y = this.#toY(line.values[k]);
      if (k === first || starts.has(k)) context.moveTo(x, y);
      else context.lineTo(x, y);
    }
    context.stroke();
  }

  #dotLine(context, line, first, end) {
    for (let k = first; k < end; k++) {
      context.fillRect(this.#toX(line.t[k]) - 0.75, this.#toY(line.values[k]) - 0.75, 1.5, 1.5);
    }
  }

  #fillBand(context, line, first, end) {
    const breaks = [first, ...line.starts.filter((k) => k > first && k < end), end];
    context.globalAlpha = 0.16;
    for (let piece = 0; piece + 1 < breaks.length; piece++) {
      context.beginPath();
      for (let k = breaks[piece]; k < breaks[piece + 1]; k++) {
        context.lineTo(this.#toX(line.t[k]), this.#toY(bandOf(line, k)[1]));
      }
      for (let k = breaks[piece + 1] - 1; k >= breaks[piece]; k--) {
        context.lineTo(this.#toX(line.t[k]), this.#toY(bandOf(line, k)[0]));
      }
      context.fill();
    }
    context.globalAlpha = 1;
  }

  #drawOverlay(context) {
    const [from, to] = this.state.span.value, t = this.state.cursor.value;
    const bottom = this.surface.height - GUTTER.bottom;
    if (this.#selected) {
      const [a, b] = this.#selected;
      context.fillStyle = themed("selection");
      context.fillRect(Math.min(a, b), GUTTER.top, Math.abs(b - a), bottom - GUTTER.top);
    }
    if (t < from || t > to || !this.limits) return;
    const x = this.#toX(t);
    context.strokeStyle = themed("ink");
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(x, GUTTER.top);
    context.lineTo(x, bottom);
    context.stroke();
    for (const line of this.chart.lines) {
      const k = sampleAt(line.t, t);
      if (k < 0) continue;
      context.beginPath();
      context.arc(this.#toX(line.t[k]), this.#toY(line.values[k]), 3, 0, 2 * Math.PI);
      context.fillStyle = this.#colour(line);
      context.fill();
    }
  }

  // What the lines say at the cursor.
  #follow() {
    this.chart.lines.forEach((line, index) => {
      const k = sampleAt(line.t, this.state.cursor.value);
      const sigma = k >= 0 && line.three_sigma ? ` ± ${figure(line.three_sigma[k], 2)} (3σ)` : "";
      this.readings[index].value = k < 0 ? "–" : figure(line.values[k], 2) + sigma;
    });
    this.surface.schedule("overlay");
  }

  #listen() {
    const { box } = this;
    box.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      const [x] = placeIn(box, event);
      this.#selected = [x, x];
      box.setPointerCapture(event.pointerId);
    });
    box.addEventListener("pointermove", (event) => {
      const [x] = placeIn(box, event);
      if (this.#selected) this.#selected[1] = x;
      this.state.cursor.set(this.#toTime(x));
    });
    box.addEventListener("pointerup", () => {
      if (!this.#selected) return;
      const [from, to] = this.#selected.map((x) => this.#toTime(x)).sort((a, b) => a - b);
      this.#selected = null;
      if (to - from >= LEAST_SPAN_S) this.state.span.set([from, to]);
      this.surface.schedule("overlay");
    });
    box.addEventListener("dblclick", () => this.state.span.set(this.page.span_s));
  }
}

// Three sigma about zero for an error, about the value for an estimate; undefined without.
function bandOf(line, k) {
  if (!line.three_sigma) return undefined;
  const middle = line.band_about_zero ? 0 : line.values[k];
  return [middle - line.three_sigma[k], middle + line.three_sigma[k]];
}
