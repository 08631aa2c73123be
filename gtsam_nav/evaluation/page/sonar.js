// The scan viewer: raw beams as a polar picture, deskewed points, and the pair of a loop.
// Bow up in all three: x forward is up, y starboard is right.

const BEARING_CELLS = 1440;
const RAW_PX = 460;

class ScanViewer {
  constructor(parts, page, state) {
    this.parts = parts;
    this.page = page;
    this.sonar = page.sonar;
    this.state = state;
    this.track = page.plan.tracks.find((track) => track.method === this.sonar.method);
    this.loops = this.track.loops;
    this.range = this.#furthest();
    this.raw = new LayeredCanvas(parts.raw, (c) => this.#drawRaw(c), () => {});
    this.scan = new LayeredCanvas(parts.scan, (c) => this.#drawScan(c), () => {});
    this.pair = new LayeredCanvas(parts.pair, (c) => this.#drawPair(c), () => {});
    this.#fillControls();
    state.cursor.watch((time) => this.#show(nearest(this.sonar.t, time)));
    state.loop.watch(() => this.#showLoop());
    this.#show(nearest(this.sonar.t, state.cursor.value));
    this.#showLoop();
  }

  // A radius that holds all that is shown, m.
  #furthest() {
    const { raw, x, y } = this.sonar;
    if (raw) return raw.bins * raw.bin_m;
    return 1.05 * x.reduce((most, forward, k) => Math.max(most, Math.hypot(forward, y[k])), 1);
  }

  #fillControls() {
    const { earlier, later, loop, placement } = this.parts;
    earlier.addEventListener("click", () => this.#step(-1));
    later.addEventListener("click", () => this.#step(1));
    loop.append(...this.loops.map((found, k) => element("option", { value: k },
      `${found.verdict}: ${figure(found.t_b, 0)} s on ${figure(found.t_a, 0)} s, `
      + `score ${figure(found.score, 2)}`)));
    loop.disabled = placement.disabled = !this.loops.length;
    placement.append(element("option", { value: "" }, "the registration"),
      ...this.page.plan.tracks.map((track) => element("option", { value: track.method },
        `${track.method}'s trajectory`)));
    loop.addEventListener("change", () => this.state.loop.set(this.loops[loop.value]));
    placement.addEventListener("change", () => this.#showLoop());
  }

  #step(by) {
    const k = Math.min(this.sonar.t.length - 1, Math.max(0, this.index + by));
    this.state.cursor.set(this.sonar.t[k]);
  }

  #show(index) {
    if (index === this.index) return;
    this.index = index;
    const [first, last] = this.sonar.first.subarray(index, index + 2);
    this.parts.which.value = `scan ${index + 1} of ${this.sonar.t.length}, `
      + `${figure(this.sonar.t[index], 1)} s, ${last - first} points`;
    this.raw.redraw();
    this.scan.redraw();
  }

  #showLoop() {
    const loop = this.state.loop.value;
    const at = this.loops.indexOf(loop);
    if (at >= 0) this.parts.loop.value = at;
    this.parts.verdict.replaceChildren(...this.#verdictLines(loop, at));
    this.pair.redraw();
  }

  #verdictLines(loop, at) {
    if (!loop) return [this.loops.length ? "Choose a loop here or on the plan." : "No loop was tried."];
    if (at < 0) return [`Only the scans of ${this.sonar.method} are kept.`];
    return loopLines(this.sonar.method, loop).slice(1).map((line) => element("div", {}, line));
  }

  // Pixels for a metre and the centre of a box.
  #scaleOf(surface) {
    const radius = Math.min(surface.width, surface.height) / 2 - 4;
    return { scale: radius / this.range, x: surface.width / 2, y: surface.height / 2 };
  }

  #drawRings(context, surface, colour) {
    const { scale, x, y } = this.#scaleOf(surface);
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = 0.7;
    const rings = ticks(0, this.range, 4);
    for (const radius of rings.values.slice(1)) {
      context.beginPath();
      context.arc(x, y, radius * scale, 0, 2 * Math.PI);
      context.stroke();
      context.fillText(`${figure(radius, rings.digits)} m`, x + 3, y - radius * scale + 12);
    }
    context.beginPath();
    context.moveTo(x, y - 8);
    context.lineTo(x + 4, y + 5);
    context.lineTo(x - 4, y + 5);
    context.fill();
  }

  #drawRaw(context) {
    const { raw } = this.sonar;
    const at = raw ? raw.scan.indexOf(this.index) : -1;
    if (at < 0) {
      context.fillStyle = themed("muted");
      context.fillText(raw ? "not kept for this scan" : "scans were extracted elsewhere", 12, 20);
      return;
    }
    const { scale, x, y } = this.#scaleOf(this.raw);
    const picture = polarPicture(raw, at);
    const radius = this.range * scale;
    context.drawImage(picture, x - radius, y - radius, 2 * radius, 2 * radius);
    this.#drawRings(context, this.raw, "rgb(255 255 255 / 0.5)");
  }

  #drawScan(context) {
    this.#drawRings(context, this.scan, themed("rings"));
    this.#drawPoints(context, this.scan, this.index, [0, 0, 0], onGround(this.page.colours[this.sonar.method]));
  }

  #drawPair(context) {
    this.#drawRings(context, this.pair, themed("rings"));
    const loop = this.state.loop.value;
    if (!this.loops.includes(loop)) return;
    const [a, b] = [loop.t_a, loop.t_b].map((time) => nearest(this.sonar.t, time));
    this.#drawPoints(context, this.pair, a, [0, 0, 0], themed("ink"));
    const pose = this.#pairPose(loop);
    if (pose) this.#drawPoints(context, this.pair, b, pose, themed("fresh"));
    else context.fillText("the registration found no pose", 12, 20);
  }

  // Pose of the later scan in the earlier: forward, starboard (m), clockwise (rad).
  #pairPose(loop) {
    const method = this.parts.placement.value;
    if (!method) return loop.dx_m === null ? null : [loop.dx_m, loop.dy_m, radians(loop.dyaw_deg)];
    const track = this.page.plan.tracks.find((found) => found.method === method);
    const [a, b] = [bodyPose(track, loop.t_a), bodyPose(track, loop.t_b)];
    const [dn, de, c, s] = [b[0] - a[0], b[1] - a[1], Math.cos(a[2]), Math.sin(a[2])];
    return [c * dn + s * de, c * de - s * dn, b[2] - a[2]];
  }

  #drawPoints(context, surface, index, [dx, dy, dyaw], colour) {
    const { scale, x, y } = this.#scaleOf(surface);
    const [c, s] = [Math.cos(dyaw), Math.sin(dyaw)];
    const [first, last] = this.sonar.first.subarray(index, index + 2);
    context.fillStyle = colour;
    for (let k = first; k < last; k++) {
      const forward = dx + c * this.sonar.x[k] - s * this.sonar.y[k];
      const starboard = dy + s * this.sonar.x[k] + c * this.sonar.y[k];
      context.fillRect(x + starboard * scale - 1.25, y - forward * scale - 1.25, 2.5, 2.5);
    }
  }
}

function radians(degrees) {
  return (degrees * Math.PI) / 180;
}

// North, east and heading of a track's body origin; the path itself is the antenna's.
function bodyPose(track, time) {
  const heading = radians(interpolated(track.t, track.heading_deg, time));
  const [forward, starboard] = track.lever_b_m;
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  return [
    interpolated(track.t, track.n, time) - c * forward + s * starboard,
    interpolated(track.t, track.e, time) - s * forward - c * starboard,
    heading,
  ];
}

// The beams of one scan as the head saw them: each pixel takes its nearest beam's bin.
function polarPicture(raw, at) {
  const [first, last] = raw.first.subarray(at, at + 2);
  const beamAt = nearestBeams(raw.bearing_deg.subarray(first, last));
  const shades = Array.from({ length: raw.levels }, (_, level) => shadeOf(level / (raw.levels - 1)));
  const canvas = new OffscreenCanvas(RAW_PX, RAW_PX);
  const picture = new ImageData(RAW_PX, RAW_PX);
  const pixels = new Uint32Array(picture.data.buffer);
  for (let row = 0; row < RAW_PX; row++) {
    for (let column = 0; column < RAW_PX; column++) {
      const right = (2 * (column + 0.5)) / RAW_PX - 1, up = 1 - (2 * (row + 0.5)) / RAW_PX;
      const bin = Math.floor(Math.hypot(right, up) * raw.bins);
      if (bin >= raw.bins) continue;
      const turn = Math.atan2(right, up) / (2 * Math.PI);
      const beam = beamAt[Math.floor((turn + 1) * BEARING_CELLS) % BEARING_CELLS];
      const level = beam < 0 ? 0 : raw.intensity[(first + beam) * raw.bins + bin];
      pixels[row * RAW_PX + column] = shades[level];
    }
  }
  canvas.getContext("2d").putImageData(picture, 0, 0);
  return canvas;
}

// For each bearing the beam that points there; -1 where none does.
function nearestBeams(bearingDeg) {
  const beamAt = new Int32Array(BEARING_CELLS).fill(-1);
  // as wide as beams are apart, and a little more
  const reach = Math.ceil((0.75 * BEARING_CELLS) / Math.max(bearingDeg.length, 90));
  const off = new Float64Array(BEARING_CELLS).fill(Infinity);
  bearingDeg.forEach((bearing, beam) => {
    const exact = ((bearing / 360 + 1) % 1) * BEARING_CELLS;
    for (let step = -reach; step <= reach; step++) {
      const cell = Math.floor(exact) + step, distance = Math.abs(cell + 0.5 - exact);
      const inside = (cell + BEARING_CELLS) % BEARING_CELLS;
      if (distance < off[inside]) [off[inside], beamAt[inside]] = [distance, beam];
    }
  });
  return beamAt;
}

// From deep water to a bright echo, as a pixel.
function shadeOf(share) {
  const strength = share ** 0.75;
  const [red, green, blue] = [[10, 255], [22, 214], [38, 130]].map(
    ([dark, bright]) => Math.round(dark + strength * (bright - dark)));
  return ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}
