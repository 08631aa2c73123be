// The report's data: each packed column of the document becomes an array.

async function inflated(base64) {
  const deflated = Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// From differences of multiples of a step, as 32-bit integers, to the values themselves.
function unpacked(bytes, step) {
  const differences = new Int32Array(bytes.buffer);
  const values = new Float64Array(differences.length);
  let multiple = 0;
  for (let k = 0; k < values.length; k++) {
    multiple += differences[k];
    values[k] = multiple * step;
  }
  return values;
}

async function unpackAll(node) {
  if (Array.isArray(node)) return Promise.all(node.map(unpackAll));
  if (node === null || typeof node !== "object") return node;
  if ("deflated" in node) return unpacked(await inflated(node.deflated), node.step);
  if ("bytes" in node) return inflated(node.bytes);
  const entries = Object.entries(node).map(async ([key, value]) => [key, await unpackAll(value)]);
  return Object.fromEntries(await Promise.all(entries));
}

// Index of the first sample at or after a time; the length where there is none.
function firstAtOrAfter(t, time) {
  let low = 0, high = t.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (t[middle] < time) low = middle + 1;
    else high = middle;
  }
  return low;
}

// Index of the sample nearest to a time; -1 without samples.
function nearest(t, time) {
  const after = firstAtOrAfter(t, time);
  if (after === 0) return t.length ? 0 : -1;
  if (after === t.length) return after - 1;
  return t[after] - time < time - t[after - 1] ? after : after - 1;
}

// The sample nearest to a time; -1 where there is silence then.
function sampleAt(t, time) {
  const k = nearest(t, time);
  const step = (t.at(-1) - t[0]) / t.length;
  return k >= 0 && Math.abs(t[k] - time) <= Math.max(5, 2 * step) ? k : -1;
}

// The value at a time, between the samples around it; held beyond the ends.
function interpolated(t, values, time) {
  const after = Math.min(t.length - 1, Math.max(1, firstAtOrAfter(t, time)));
  const share = Math.min(1, Math.max(0, (time - t[after - 1]) / (t[after] - t[after - 1])));
  return values[after - 1] + share * (values[after] - values[after - 1]);
}
