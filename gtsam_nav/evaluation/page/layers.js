// What the plan shows, a layer each: {key, label, mark, colour(), visible, draw, overlay, pick}.
//
// draw and overlay get a canvas context and the view; pick gets a place on the screen and the view,
// and returns {distance, lines, time, loop} of the nearest that it shows, or nothing.

const PICK_PX = 7;
const SIGMAS = 3;
// Landmarks that are drawn with their number; more would hide each other.
const MOST_NAMED = 60;

function planLayers(plan, colours, state) {
  const layers = [];
  if (plan.map) layers.push(mapLayer(plan.map));
  for (const track of plan.tracks) {
    for (const verdict of ["rejected", "accepted"]) {
      const loops = track.loops.filter((loop) => loop.verdict === verdict);
      if (loops.length) layers.push(loopLayer(track, loops, verdict, state));
    }
  }
  if (plan.fixes.used.t.length) layers.push(usedFixes(plan.fixes.used));
  if (plan.fixes.rejected.length) layers.push(rejectedFixes(plan.fixes.rejected));
  if (plan.survey.length) layers.push(surveyLayer(plan.survey));
  if (plan.reference) layers.push(referenceLayer(plan.reference, state));
  // the foremost comes first in the document and is drawn last
  for (const track of [...plan.tracks].reverse()) {
    const colour = () => onGround(colours[track.method]);
    if (track.online) layers.push(onlineLayer(track, colour));
    layers.push(trackLayer(track, colour, state));
    if (track.landmarks.length) layers.push(landmarkLayer(track, colour));
  }
  return layers;
}

function mapLayer(map) {
  return {
    key: "map",
    label: `${map.name} (${map.method})`,
    mark: "dots",
    colour: () => themed("echo"),
    visible: true,
    draw(context, view) {
      drawCloud(context, view, map, this.colour());
    },
  };
}

function referenceLayer(reference, state) {
  return {
    key: "reference",
    label: "reference",
    mark: "line",
    colour: () => themed("ink"),
    visible: true,
    draw(context, view) {
      strokePath(context, view, reference, this.colour(), 1.2);
    },
    overlay(context, view) {
      const k = sampleAt(reference.t, state.cursor.value);
      if (k < 0) return;
      const [x, y] = view.toScreen(reference.n[k], reference.e[k]);
      context.beginPath();
      context.arc(x, y, 6, 0, 2 * Math.PI);
      context.strokeStyle = this.colour();
      context.lineWidth = 1.5;
      context.stroke();
    },
    pick: (place, view) => pickPath(place, view, reference),
  };
}

function trackLayer(track, colour, state) {
  return {
    key: track.method,
    label: track.method + track.note,
    mark: "line",
    colour,
    visible: true,
    draw(context, view) {
      strokePath(context, view, track, colour(), 1.7);
    },
    overlay(context, view) {
      const k = sampleAt(track.t, state.cursor.value);
      if (k < 0) return;
      context.strokeStyle = colour();
      if (track.sigma_n) {
        const [n, e, r] = [track.sigma_n[k], track.sigma_e[k], track.correlation[k]];
        context.lineWidth = 1.2;
        strokeEllipse(context, view, [track.n[k], track.e[k]], [n * n, e * e, n * e * r]);
      }
      const [x, y] = view.toScreen(track.n[k], track.e[k]);
      drawVehicle(context, x, y, (track.heading_deg[k] * Math.PI) / 180, colour());
    },
    pick: (place, view) => pickPath(place, view, track),
  };
}

function onlineLayer(track, colour) {
  return {
    key: `${track.method}-causal`,
    label: `${track.method}, causal`,
    mark: "dashes",
    colour,
    visible: false,
    draw(context, view) {
      context.setLineDash([4, 4]);
      strokePath(context, view, { starts: [], ...track.online }, colour(), 1.2);
      context.setLineDash([]);
    },
  };
}

function loopLayer(track, loops, verdict, state) {
  const accepted = verdict === "accepted";
  return {
    key: `${track.method}-loops-${verdict}`,
    label: `${track.method}: loops ${verdict} (${loops.length})`,
    mark: accepted ? "line" : "dashes",
    colour: () => themed(verdict),
    visible: true,
    draw(context, view) {
      context.strokeStyle = this.colour();
      context.lineWidth = accepted ? 1 : 1.2;
      context.globalAlpha = accepted ? 0.5 : 0.8;
      context.setLineDash(accepted ? [] : [5, 3]);
      context.beginPath();
      for (const loop of loops) traceLoop(context, view, loop);
      context.stroke();
      context.setLineDash([]);
      context.globalAlpha = 1;
    },
    overlay(context, view) {
      const chosen = [state.hovered.value, state.loop.value].filter((loop) => loops.includes(loop));
      for (const loop of chosen) highlightLoop(context, view, loop, this.colour());
    },
    pick(place, view) {
      return pickNearest(loops, (loop) => distanceToSegment(place,
        view.toScreen(...loop.ne_a), view.toScreen(...loop.ne_b)), (loop) => ({
        loop, lines: loopLines(track.method, loop),
      }));
    },
  };
}

function loopLines(method, loop) {
  const lines = [
    `${method}: loop ${loop.verdict}`,
    `scans at ${figure(loop.t_b, 1)} s and ${figure(loop.t_a, 1)} s`,
    `score ${figure(loop.score, 2)}`,
  ];
  if (loop.weight !== null) lines[2] += `, weight ${figure(loop.weight, 2)}`;
  if (loop.dx_m !== null) {
    const [dx, dy] = [figure(loop.dx_m, 2), figure(loop.dy_m, 2)];
    lines.push(`${dx} m forward, ${dy} m starboard, ${figure(loop.dyaw_deg, 1)}° clockwise`);
  }
  if (loop.reason) lines.push(loop.reason);
  return lines;
}

function usedFixes(fixes) {
  return {
    key: "gnss-used",
    label: `GNSS used (${fixes.t.length})`,
    mark: "dots",
    colour: () => themed("fix"),
    visible: true,
    draw(context, view) {
      context.fillStyle = this.colour();
      for (let k = 0; k < fixes.t.length; k++) {
        const [x, y] = view.toScreen(fixes.n[k], fixes.e[k]);
        context.beginPath();
        context.arc(x, y, 2.2, 0, 2 * Math.PI);
        context.fill();
      }
    },
  };
}

function rejectedFixes(fixes) {
  return {
    key: "gnss-rejected",
    label: `GNSS rejected (${fixes.length})`,
    mark: "cross",
    colour: () => themed("rejected"),
    visible: true,
    draw(context, view) {
      context.strokeStyle = this.colour();
      context.lineWidth = 1.4;
      for (const fix of fixes) strokeCross(context, ...view.toScreen(...fix.ne), 3.5);
    },
    pick: (place, view) => pickNearest(fixes, (fix) => distanceTo(place, view.toScreen(...fix.ne)),
      (fix) => ({ time: fix.t, lines: [`fix at ${figure(fix.t, 1)} s rejected`, fix.reason] })),
  };
}

function surveyLayer(survey) {
  return {
    key: "survey",
    label: "surveyed landmarks",
    mark: "square",
    colour: () => themed("ink"),
    visible: true,
    draw(context, view) {
      context.strokeStyle = this.colour();
      context.lineWidth = 1.1;
      for (const { ne } of survey) {
        const [x, y] = view.toScreen(...ne);
        context.strokeRect(x - 4.5, y - 4.5, 9, 9);
      }
    },
    pick: (place, view) => pickNearest(survey, (mark) => distanceTo(place, view.toScreen(...mark.ne)),
      (mark) => ({ lines: [`surveyed landmark ${mark.id}`] })),
  };
}

function landmarkLayer(track, colour) {
  return {
    key: `${track.method}-landmarks`,
    label: `${track.method}: landmarks, ${SIGMAS} sigma (${track.landmarks.length})`,
    mark: "plus",
    colour,
    visible: true,
    draw(context, view) {
      context.strokeStyle = colour();
      context.lineWidth = 1.2;
      for (const landmark of track.landmarks) {
        const [x, y] = view.toScreen(...landmark.ne);
        strokePlus(context, x, y, 4);
        strokeEllipse(context, view, landmark.ne, landmark.cov);
        if (track.landmarks.length > MOST_NAMED) continue;
        context.fillStyle = themed("ink");
        context.fillText(landmark.id, x + 5, y - 5);
      }
    },
    pick: (place, view) => pickNearest(track.landmarks,
      (landmark) => distanceTo(place, view.toScreen(...landmark.ne)), (landmark) => ({
        lines: [
          `${track.method}: landmark ${landmark.id}`,
          `sigma ${figure(Math.sqrt(landmark.cov[0]), 2)} m north, `
          + `${figure(Math.sqrt(landmark.cov[1]), 2)} m east`,
        ],
      })),
  };
}
