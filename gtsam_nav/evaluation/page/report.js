// The page comes alive: one cursor in time, one span, one loop for all views.

const part = (id) => document.getElementById(id);

const page = await unpackAll(JSON.parse(part("report-data").textContent));
const registered = page.plan.tracks.find((track) => track.method === page.sonar?.method);
const firstLoop = registered?.loops.find((loop) => loop.verdict === "accepted") ?? null;
const state = {
  cursor: new Observed(firstLoop?.t_b ?? page.span_s[0]),
  span: new Observed(page.span_s),
  hovered: new Observed(null),
  loop: new Observed(firstLoop),
};

part("interactive").hidden = false;
part("starting").remove();

const plan = new Plan(part("plan"), part("layers"), page.plan, page.colours, state);
part("zoom-in").addEventListener("click", () => plan.zoom(ZOOM_STEP));
part("zoom-out").addEventListener("click", () => plan.zoom(1 / ZOOM_STEP));
part("zoom-all").addEventListener("click", () => plan.fit());

for (const chart of page.charts) new Chart(part("charts"), chart, page, state);
part("whole-span").addEventListener("click", () => state.span.set(page.span_s));
state.span.watch(([from, to]) => {
  part("whole-span").disabled = from === page.span_s[0] && to === page.span_s[1];
});

const slider = part("time");
[slider.min, slider.max] = [Math.floor(page.span_s[0]), Math.ceil(page.span_s[1])];
slider.addEventListener("input", () => state.cursor.set(slider.valueAsNumber));
state.cursor.watch((time) => {
  slider.value = time;
  part("time-reading").value = `${figure(time, 1)} s`;
});

if (page.sonar) {
  part("sonar").hidden = false;
  const names = ["raw", "scan", "pair", "earlier", "later", "which", "loop", "placement", "verdict"];
  const parts = Object.fromEntries(names.map((name) => [name, part(`sonar-${name}`)]));
  new ScanViewer(parts, page, state);
  state.loop.watch((loop) => loop && state.cursor.set(loop.t_b));
}
state.cursor.set(state.cursor.value);
