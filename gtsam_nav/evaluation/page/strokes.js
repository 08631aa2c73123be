// How the plan's layers are drawn and found: lines, clouds, ellipses, marks, distances.

// A path with a break at each of its starts; steps that no screen shows are left out.
function strokePath(context, view, path, colour, width) {
  const starts = new Set(path.starts);
  let lastX = NaN, lastY = NaN;
  context.beginPath();
  for (let k = 0; k < path.n.length; k++) {
    const [x, y] = view.toScreen(path.n[k], path.e[k]);
    if (k === 0 || starts.has(k)) context.moveTo(x, y);
    else if (Math.abs(x - lastX) + Math.abs(y - lastY) < 0.7) continue;
    else context.lineTo(x, y);
    [lastX, lastY] = [x, y];
  }
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}

// Points by the pixel, darker where they are many: a hundred thousand in a few milliseconds.
function drawCloud(context, view, cloud, colour) {
  const { width, height } = context.canvas;
  const density = context.getTransform().a;
  const size = Math.max(1, Math.min(5, Math.round(density * Math.max(1.5, view.scale / 8))));
  const counts = new Uint16Array(width * height);
  for (let k = 0; k < cloud.n.length; k++) {
    const [x, y] = view.toScreen(cloud.n[k], cloud.e[k]);
    const column = Math.round(x * density), row = Math.round(y * density);
    if (column < 0 || row < 0 || column + size > width || row + size > height) continue;
    for (let down = 0; down < size; down++) {
      for (let right = 0; right < size; right++) counts[(row + down) * width + column + right]++;
    }
  }
  context.fillStyle = colour;
  const [red, green, blue] = rgbOf(context.fillStyle);
  const picture = new ImageData(width, height);
  const pixels = new Uint32Array(picture.data.buffer);
  for (let k = 0; k < counts.length; k++) {
    if (!counts[k]) continue;
    const alpha = Math.round(255 * (1 - 0.6 ** counts[k]));
    pixels[k] = (alpha << 24) | (blue << 16) | (green << 8) | red;
  }
  const canvas = new OffscreenCanvas(width, height);
  canvas.getContext("2d").putImageData(picture, 0, 0);
  context.drawImage(canvas, 0, 0, width / density, height / density);
}

// Red, green and blue of a colour as canvases write it.
function rgbOf(colour) {
  return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
}

// The outline of three sigma about a place, from the covariance's (n, n), (e, e) and (n, e).
function strokeEllipse(context, view, ne, [nn, ee, ne_]) {
  const mean = (nn + ee) / 2, spread = Math.hypot((nn - ee) / 2, ne_);
  const major = SIGMAS * Math.sqrt(Math.max(mean + spread, 0)) * view.scale;
  const minor = SIGMAS * Math.sqrt(Math.max(mean - spread, 0)) * view.scale;
  const fromNorth = 0.5 * Math.atan2(2 * ne_, nn - ee);
  context.beginPath();
  // on the screen angles run clockwise from east
  context.ellipse(...view.toScreen(...ne), major, minor, fromNorth - Math.PI / 2, 0, 2 * Math.PI);
  context.stroke();
}

function strokeCross(context, x, y, size) {
  context.beginPath();
  context.moveTo(x - size, y - size);
  context.lineTo(x + size, y + size);
  context.moveTo(x - size, y + size);
  context.lineTo(x + size, y - size);
  context.stroke();
}

function strokePlus(context, x, y, size) {
  context.beginPath();
  context.moveTo(x - size, y);
  context.lineTo(x + size, y);
  context.moveTo(x, y - size);
  context.lineTo(x, y + size);
  context.stroke();
}

// An arrowhead that points where the bow does.
function drawVehicle(context, x, y, heading, colour) {
  context.save();
  context.translate(x, y);
  context.rotate(heading);
  context.beginPath();
  context.moveTo(0, -11);
  context.lineTo(6, 7);
  context.lineTo(0, 3.5);
  context.lineTo(-6, 7);
  context.closePath();
  context.fillStyle = colour;
  context.strokeStyle = themed("paper");
  context.lineWidth = 1.5;
  context.fill();
  context.stroke();
  context.restore();
}

function traceLoop(context, view, loop) {
  context.moveTo(...view.toScreen(...loop.ne_a));
  context.lineTo(...view.toScreen(...loop.ne_b));
}

function highlightLoop(context, view, loop, colour) {
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = 3;
  context.beginPath();
  traceLoop(context, view, loop);
  context.stroke();
  for (const ne of [loop.ne_a, loop.ne_b]) {
    context.beginPath();
    context.arc(...view.toScreen(...ne), 4, 0, 2 * Math.PI);
    context.fill();
  }
}

function distanceTo([x, y], [otherX, otherY]) {
  return Math.hypot(x - otherX, y - otherY);
}

function distanceToSegment([x, y], [ax, ay], [bx, by]) {
  const [ux, uy] = [bx - ax, by - ay];
  const along = ((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy || 1);
  const inside = Math.min(1, Math.max(0, along));
  return Math.hypot(x - ax - inside * ux, y - ay - inside * uy);
}

// The nearest of some things within reach, described; undefined where none is.
function pickNearest(things, distance, describe) {
  let best, least = PICK_PX;
  for (const thing of things) {
    const found = distance(thing);
    if (found <= least) [best, least] = [thing, found];
  }
  return best && { distance: least, ...describe(best) };
}

// The time at which a path passed nearest to a place on the screen.
function pickPath(place, view, path) {
  let least = 3 * PICK_PX, at = -1;
  for (let k = 0; k < path.n.length; k++) {
    const distance = distanceTo(place, view.toScreen(path.n[k], path.e[k]));
    if (distance < least) [least, at] = [distance, k];
  }
  return at < 0 ? undefined : { distance: least, time: path.t[at] };
}
