"use strict";

performance.mark("report-begins");

/** What `gerono report` gathered; see orchestrator/report/src/page.rs. */
const data = JSON.parse(document.getElementById("data").textContent);

/** Two panels of this width stand beside each other on A4 and letter, px. */
const PRINTED_WIDTH = 325;
/* ---- The numbers ---- */

function decode(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let index = 0; index < raw.length; index++) bytes[index] = raw.charCodeAt(index);
  return new Float32Array(bytes.buffer);
}

const knownTimes = new Map();

/** Times of a table's values; tables of equal times share them, which need not be joined then. */
function timesOf(table) {
  const count = table.series.length === 0 ? 0 : table.series[0].numbers.length;
  const key = [count, table.first, table.step, table.samples_per_bucket].join();
  if (!knownTimes.has(key)) knownTimes.set(key, timesOfBuckets(table, count));
  return knownTimes.get(key);
}

/** Of two values in a bucket the first is drawn in its first half, the second in its second. */
function timesOfBuckets(table, count) {
  const places = table.values_per_bucket === 1 ? [0] : [0.25, 0.75];
  const sample = table.step / table.samples_per_bucket;
  const width = table.step - sample;
  const times = new Array(count);
  for (let index = 0; index < count; index++) {
    const bucket = Math.floor(index / places.length);
    times[index] = table.first + bucket * table.step + places[index % places.length] * width;
  }
  return times;
}

/** NaN means that there is no value: a gap in a curve. */
function withGaps(numbers, least) {
  return Array.from(numbers, (value) => (Number.isNaN(value) ? null : Math.max(value, least)));
}

function prepare(flight) {
  flight.shown = true;
  for (const table of flight.tables) {
    for (const series of table.series) series.numbers = decode(series.values);
    table.times = timesOf(table);
  }
  const numbers = decode(flight.track.places);
  const size = flight.track.numbers_per_place;
  flight.places = Array.from({ length: numbers.length / size }, (_, index) => {
    const place = Array.from(numbers.subarray(index * size, (index + 1) * size));
    return { time: place[0], position: place.slice(1, 4), desired: place.slice(4, 7), attitude: place.slice(7, 10) };
  });
}

data.flights.forEach(prepare);
const { flights } = data;
const isOne = flights.length === 1;
const end = Math.max(...flights.map((flight) => flight.flown), 1e-3);

function table(flight, topic) {
  return flight.tables.find((candidate) => candidate.topic === topic);
}

/** The values of a channel of a flight, or none if it never had any. */
function channel(flight, { topic, channel: name }) {
  const found = table(flight, topic);
  const series = found?.series.find((candidate) => candidate.name === name);
  return series && { times: found.times, numbers: series.numbers };
}

/* ---- Panels over time ---- */

const view = { from: 0, to: end };
const plots = [];
const sync = uPlot.sync("time");

/** With several flights each quantity has a panel of its own: colours then tell flights apart. */
function panelsToDraw() {
  return data.panels.flatMap((panel) => {
    if (isOne) return [panel];
    return panel.groups.map((group) => ({
      ...panel,
      title: group.name === "" ? panel.title : `${panel.title}: ${group.name}`,
      groups: [group],
    }));
  });
}

function curvesOf(panel) {
  const curves = [];
  flights.forEach((flight, place) => {
    panel.groups.forEach((group, groupPlace) => {
      for (const curve of group.curves) {
        const values = channel(flight, curve);
        if (values === undefined) continue;
        const color = isOne ? groupPlace : place;
        const label = isOne ? curve.label : `${flight.label}: ${curve.label}`;
        curves.push({ ...curve, ...values, flight, color, label });
      }
    });
  });
  // What is solid lies on what is not.
  return curves.sort((left, right) => right.dash - left.dash);
}

/** All curves on one axis of time; where only one of two curves has a point, the other goes through. */
function joined(curves, least) {
  const RETAIN_GAPS = 1;
  const tables = curves.map(({ times, numbers }) => [times, withGaps(numbers, least)]);
  const [[first]] = tables;
  if (tables.every(([times]) => times === first)) return [first, ...tables.map(([, values]) => values)];
  return uPlot.join(tables, curves.map(() => [RETAIN_GAPS, RETAIN_GAPS]));
}

/** The place of a curve's value that is nearest to a place where it has none, because only others have a point there. */
function nearestPlace(plot, series, place) {
  const values = plot.data[series];
  if (series === 0 || values[place] !== undefined) return place;
  for (let away = 1; away < values.length; away++) {
    if (values[place - away] !== undefined) return place - away;
    if (values[place + away] !== undefined) return place + away;
  }
  return place;
}

function draw(panel) {
  const curves = curvesOf(panel);
  if (curves.length === 0) return;
  const holder = element("div", { class: "panel", tabindex: "0", role: "group", "aria-label": `${panel.title} over time`, onkeydown: steer },
    element("h3", {}, panel.title, element("span", {}, panel.unit)));
  byId("panels").append(holder);
  const options = {
    width: holder.clientWidth - 18,
    height: PANEL_HEIGHT,
    scales: {
      x: { time: false, range: () => [view.from, view.to] },
      y: { distr: panel.is_logarithmic ? 3 : 1, range: rangeUpwards(panel, boundsOfAll(panel)) },
    },
    axes: axes(panel),
    series: [
      { label: "time", value: timeAtPointer },
      ...curves.map((curve) => ({
        label: curve.label,
        stroke: () => `${colorOf(curve.color)}${curve.dash === 0 ? "" : "b8"}`,
        width: 1.4,
        dash: DASHES[curve.dash],
        points: { show: false },
        value: (_, value) => inDigits(value),
      })),
    ],
    cursor: {
      sync: { key: sync.key, setSeries: false },
      drag: { x: true, y: false, setScale: false },
      points: { size: 6 },
      dataIdx: nearestPlace,
      bind: { dblclick: () => showAll },
    },
    legend: { markers: { dash: (_, series) => DASH_NAMES[curves[series - 1]?.dash ?? 0] } },
    hooks: {
      drawClear: [shadeFaults],
      drawAxes: [(plot) => drawMarks(plot, shownMarks(), shownBounds(panel))],
      draw: [(plot) => nameBounds(plot, shownBounds(panel))],
      setSelect: [selected],
      setCursor: [pointed],
    },
  };
  const plot = new uPlot(options, joined(curves, panel.is_logarithmic ? FLOOR : -Infinity), holder);
  plot.curves = curves;
  plot.over.addEventListener("mouseleave", hideTip);
  plots.push(plot);
}

function timeAtPointer(plot) {
  const { left } = plot.cursor;
  return left === null || left === undefined || left < 0 ? "–" : `${plot.posToVal(left, "x").toFixed(3)} s`;
}

function shadeFaults(plot) {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.fillStyle = variable("--fault");
  ctx.globalAlpha = 0.16;
  for (const span of shownFlights().flatMap((flight) => flight.spans)) {
    const left = Math.max(plot.valToPos(span.from, "x", true), bbox.left);
    const right = Math.min(plot.valToPos(span.to ?? end, "x", true), bbox.left + bbox.width);
    if (right > left) ctx.fillRect(left, bbox.top, right - left, bbox.height);
  }
  ctx.restore();
}

/** The theorem's bounds, the largest first; flights without a bound have none. */
const theoremBounds = (panel, some) => (panel.has_bound ? [...new Set(some.map(({ bound }) => bound))].filter((bound) => bound !== null).sort((left, right) => right - left) : []);
const boundsOfAll = (panel) => theoremBounds(panel, flights);
const shownBounds = (panel) => theoremBounds(panel, shownFlights());


/* ---- One stretch of time for all panels ---- */

function show(from, to) {
  const shortest = 1e-3;
  const length = Math.min(Math.max(to - from, shortest), end);
  view.from = Math.min(Math.max(from, 0), end - length);
  view.to = view.from + length;
  for (const plot of plots) plot.setScale("x", { min: view.from, max: view.to });
  [byId("from").value, byId("to").value] = [view.from, view.to].map((time) => Number(time.toFixed(4)));
  sayBuckets();
  orbit.view = [view.from, view.to];
  orbit.draw();
}

function showAll() {
  show(0, end);
}

function selected(plot) {
  const { left, width } = plot.select;
  if (width < 4) return;
  const [from, to] = [left, left + width].map((x) => plot.posToVal(x, "x"));
  plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
  show(from, to);
}

/** Zooms and moves with the keyboard. */
function steer(event) {
  const length = view.to - view.from;
  const middle = (view.from + view.to) / 2;
  const action = {
    "+": () => show(middle - length / 4, middle + length / 4),
    "=": () => show(middle - length / 4, middle + length / 4),
    "-": () => show(middle - length, middle + length),
    ArrowLeft: () => show(view.from - length / 5, view.to - length / 5),
    ArrowRight: () => show(view.from + length / 5, view.to + length / 5),
    Home: showAll,
    Escape: showAll,
  }[event.key];
  if (action) {
    event.preventDefault();
    action();
  }
}

/** How many samples a point on the screen stands for: downsampling is always stated. */
function sayBuckets() {
  const columns = Math.max(1, ...plots.map((plot) => plot.bbox.width));
  const finest = flights.flatMap((flight) => flight.tables).filter(({ series }) => series.length > 0);
  const samplesKept = Math.max(...finest.map((kept) => kept.samples_per_bucket));
  const step = Math.min(...finest.map((kept) => kept.step / kept.samples_per_bucket));
  const perColumn = (view.to - view.from) / columns / step;
  const kept = samplesKept > 1
    ? `Of every ${samplesKept} samples the smallest and the largest are kept, in their order.`
    : "Every sample is kept.";
  byId("bucket").textContent = `${kept} Now a column of pixels stands for ${perColumn < 1 ? "less than one sample" : `up to ${Math.ceil(perColumn)} samples`}.`;
}

/* ---- The selected moment ---- */

let moment = 0;

function lookAt(time) {
  moment = Math.min(Math.max(time, 0), end);
  byId("moment").value = moment;
  byId("now").textContent = `${moment.toFixed(3)} s`;
  orbit.moment = moment;
  orbit.draw();
}

let frame = null;

/** The pointer moves more often than anything can be drawn. The other panels follow it. */
function pointed(plot) {
  const { left, top } = plot.cursor;
  if (left === null || left < 0 || player !== null || !plot.over.matches(":hover")) return;
  const time = plot.posToVal(left, "x");
  if (frame === null) {
    frame = requestAnimationFrame(() => {
      frame = null;
      lookAt(time);
    });
  }
  showTip(plot, left, top);
}

function showTip(plot, left, top) {
  const NEAR = 5;
  const near = shownMarks().filter((mark) => Math.abs(plot.valToPos(mark.time, "x") - left) <= NEAR);
  const time = plot.posToVal(left, "x");
  const during = shownFlights().flatMap((flight) => flight.spans
    .filter((span) => time >= span.from && time <= (span.to ?? end))
    .map((span) => `${named(flight)}${span.text}`));
  const isNew = (text) => near.every((mark) => mark.text !== text);
  const lines = [...new Set([...near.map((mark) => `${label(mark.time)} s: ${mark.text}`), ...during.filter(isNew)])];
  const tip = byId("tip");
  tip.hidden = lines.length === 0;
  if (tip.hidden) return;
  tip.textContent = lines.join("\n");
  const box = plot.over.getBoundingClientRect();
  const right = Math.min(box.left + left + 14, innerWidth - tip.offsetWidth - 8);
  tip.style.left = `${Math.max(8, right)}px`;
  tip.style.top = `${box.top + top + 14}px`;
}

function hideTip() {
  byId("tip").hidden = true;
}

let player = null;

/** Plays the flight as fast as it was flown. */
function play() {
  const button = byId("play");
  if (player !== null) {
    cancelAnimationFrame(player);
    player = null;
  } else {
    let last = performance.now();
    if (moment >= view.to) lookAt(view.from);
    const advance = (now) => {
      lookAt(moment + (now - last) / 1000);
      last = now;
      for (const plot of plots) plot.setCursor({ left: plot.valToPos(moment, "x"), top: 0 }, false);
      player = moment < view.to ? requestAnimationFrame(advance) : null;
      if (player === null) sayPlaying(button);
    };
    player = requestAnimationFrame(advance);
  }
  sayPlaying(button);
}

function sayPlaying(button) {
  button.setAttribute("aria-pressed", String(player !== null));
  button.textContent = player === null ? "▶ play" : "❚❚ pause";
}

/* ---- Flights and what happened in them ---- */

const shownFlights = () => flights.filter((flight) => flight.shown);
const named = (flight) => (isOne ? "" : `${flight.label}: `);

function shownMarks() {
  return shownFlights().flatMap((flight) => flight.marks.map((mark) => ({ ...mark, text: `${named(flight)}${mark.text}` })));
}

function toggle(flight, button) {
  flight.shown = !flight.shown;
  button.setAttribute("aria-pressed", String(flight.shown));
  for (const plot of plots) {
    plot.batch(() => plot.curves.forEach((curve, place) => {
      if (curve.flight === flight) plot.setSeries(place + 1, { show: flight.shown });
    }));
    plot.redraw();
  }
  orbit.draw();
}

function drawChips() {
  flights.forEach((flight, place) => {
    const button = element("button", { type: "button", "aria-pressed": "true", title: "show or hide this flight" }, flight.label);
    button.addEventListener("click", () => toggle(flight, button));
    byId("flights").append(button);
    flight.chip = button;
    flight.place = place;
  });
}

function drawHead() {
  byId("title").textContent = flights.map((flight) => flight.label).join(" · ");
  byId("description").textContent = [...new Set(flights.map((flight) => flight.description).filter(Boolean))].join(" — ");
  for (const flight of flights.filter(({ track }) => track.is_estimated)) {
    byId("banners").append(element("p", { class: "banner" },
      `${named(flight)}the trajectory in the 3D view is the estimator's: a laboratory flight has no recorded truth.`));
  }
  for (const flight of flights.filter(({ killed }) => killed !== null)) {
    const { time, by, after_landing: hasLanded } = flight.killed;
    byId("banners").append(element("p", { class: hasLanded ? "banner" : "banner alarm", role: "alert" },
      `${named(flight)}the flight was KILLED at ${label(time)} s${hasLanded ? ", after the landing" : ""}: ${by}.`));
  }
  for (const flight of flights.filter(({ failed_take_off: failed }) => failed !== null)) {
    byId("banners").append(element("p", { class: "banner alarm", role: "alert" }, `${named(flight)}${flight.failed_take_off}`));
  }
  for (const flight of flights.filter(({ response }) => response !== null)) {
    byId("banners").append(element("p", { class: "banner alarm", role: "alert" }, `${named(flight)}WRONG: ${flight.response}.`));
  }
  for (const flight of flights.filter(({ navigation }) => navigation !== null)) {
    byId("banners").append(element("p", { class: "banner", role: "alert" }, `${named(flight)}NAVIGATION: ${flight.navigation}.`));
  }
  for (const flight of flights.filter(({ lost }) => lost !== null)) {
    byId("banners").append(element("p", { class: "banner alarm", role: "alert" },
      `${named(flight)}the vehicle was LOST at ${label(flight.lost.time)} s: ${flight.lost.words}.`));
  }
  for (const flight of flights.filter(({ lost, steady }) => lost === null && steady !== null)) {
    byId("headlines").append(element("p", {},
      `${named(flight)}${centimetres(flight.steady.rmse)} cm from the path in steady state (root mean square, ${label(flight.steady.span[0])} to ${label(flight.steady.span[1])} s${flight.source === "estimate" ? ", as estimated" : ""}).`));
  }
  for (const flight of flights.filter(({ broken }) => broken !== null)) {
    byId("banners").append(element("p", { class: "banner", role: "alert" },
      `${named(flight)}only a part of this flight could be read, up to ${inDigits(flight.flown)} s of ${inDigits(flight.duration)} s. ${flight.broken}`));
  }
  for (const flight of flights.filter(({ facts }) => facts?.outcome === "failed")) {
    byId("banners").append(element("p", { class: "banner", role: "alert" }, `${named(flight)}the flight failed at ${label(flight.flown)} s. ${flight.facts.reason}`));
  }
  byId("fence").hidden = flights.every(({ envelope_box: fence }) => fence === null);
  byId("footer").textContent = `gerono ${data.version}. Frames: {I}, z down; lengths in m, times in s, angles in rad.`;
}

function drawMarkList() {
  const marks = shownMarks().sort((left, right) => left.time - right.time);
  for (const mark of marks) {
    const jump = () => {
      show(mark.time - end / 40, mark.time + end / 10);
      lookAt(mark.time);
      byId("over-time").scrollIntoView({ behavior: "smooth" });
    };
    byId("marks").append(element("li", {}, element("button", { type: "button", onclick: jump }, element("time", {}, `${label(mark.time)} s`), element("span", {}, mark.text))));
  }
  byId("events").hidden = marks.length === 0 && flights.every(({ faults }) => faults.length === 0);
}

/* ---- Tables ---- */

const AGAINST_BOUND = { within: "within the bound", near: "near the bound", exceeded: "above the bound" };
const vector = (values) => (values ? `[${values.map((value) => value.toFixed(3)).join(", ")}]` : "–");
const number = (value, digits = 4) => (value === null || value === undefined ? "–" : value.toFixed(digits));
const centimetres = (value) => (value === null || value === undefined ? "–" : inDigits(100 * value));
const ofMetrics = (show) => ({ metrics }) => (metrics ? show(metrics) : "–");

/** The metrics of a flight's phases and of the whole flight. */
function drawPhases(flight) {
  const ofPhase = (show) => (stretch) => (stretch.parameters ? show(stretch) : "");
  const ofSteady = (show) => ofPhase(({ steady }) => (steady ? show(steady) : "–"));
  const rows = [
    ["distance from the path in steady state: RMS, cm", ofSteady(({ rmse }) => centimetres(rmse))],
    ["from, s", ofSteady(({ span: [from] }) => number(from, 3))],
    ["95 %, cm", ofSteady(({ p95 }) => centimetres(p95))],
    ["largest, cm", ofSteady(({ max }) => centimetres(max))],
    ["in the transient: RMS, cm", ofPhase(({ transient }) => (transient ? centimetres(transient.rmse) : "–"))],
    ["in the whole: RMS, cm", ofMetrics(({ rmse }) => centimetres(rmse))],
    ["standard deviation, cm", ofMetrics(({ deviation }) => centimetres(deviation))],
    ["median, cm", ofMetrics(({ p50 }) => centimetres(p50))],
    ["95 %, cm", ofMetrics(({ p95 }) => centimetres(p95))],
    ["99 %, cm", ofMetrics(({ p99 }) => centimetres(p99))],
    ["largest, cm", ofMetrics(({ max, time_of_max: time }) => `${centimetres(max)} at ${label(time)} s`)],
    ["largest in the last 5 s, cm", ofPhase(({ ultimate, is_complete: isComplete }) => (ultimate === null ? (isComplete ? "not on the path" : "not flown to its end") : centimetres(ultimate)))],
    ["against the theorem", ofPhase(({ against_bound: verdict }) => (verdict ? element("span", { class: verdict }, AGAINST_BOUND[verdict]) : "–"))],
    ["below 2 cm after, s", ofPhase(({ metrics }) => (metrics === null ? "–" : metrics.settling_time === null ? "not settled" : number(metrics.settling_time, 3)))],
    ["mean thrust, N", ofMetrics(({ thrust_mean: thrust }) => number(thrust, 3))],
    ["body rate, root mean square, rad/s", ofMetrics(({ body_rate_rms: rate }) => number(rate, 3))],
    ["frames at a limit, %", ofMetrics(({ saturated_share: share }) => (share === null ? "–" : inDigits(100 * share)))],
    ["mass, kg", ofPhase(({ parameters }) => number(parameters.mass))],
    ["mass estimated", ofPhase(({ parameters }) => number(parameters.mass_estimate))],
    ["disturbance, m/s²", ofPhase(({ parameters }) => vector(parameters.disturbance))],
    ["disturbance estimated", ofPhase(({ parameters }) => vector(parameters.disturbance_estimate))],
    ["γ at the end", ofPhase(({ gamma }) => number(gamma, 3))],
  ].filter(([name]) => name !== "against the theorem" || flight.bound !== null);
  const stretches = flight.phases.length === 1 ? flight.phases : [...flight.phases, { metrics: flight.metrics }];
  const head = ({ begins, ends }) => (begins === undefined ? "all" : `${label(begins)} to ${label(ends)} s`);
  byId("phases").append(
    ...(isOne ? [] : [element("h3", {}, flight.label)]),
    tableOf(["", ...stretches.map(head)], rows.map(([name, of]) => [name, ...stretches.map(of)])));
}

function drawResults() {
  flights.forEach(drawPhases);
  const bounds = [...new Set(flights.map(({ bound }) => bound))].filter((bound) => bound !== null).map(inDigits).join(", ");
  const theorem = bounds === "" ? "" : ` The theorem bounds its limit for t → ∞ by ${bounds} m.`;
  const estimated = flights.some(({ source }) => source === "estimate") ? " In a laboratory it is estimated: the truth is not recorded." : "";
  byId("phases").append(element("p", { class: "hint" },
    `Distance from the path: from the true position to the path's point of the same time, while the vehicle flies along its path.${estimated}${theorem}`));
}

function drawInnovations() {
  const rows = flights.flatMap((flight) => flight.innovations.map((source) => [
    `${named(flight)}${source.source}`, source.fused, source.refused, source.unusable, number(source.mean_square, 3),
    source.freedom > 0 ? `${source.freedom} ± ${number(source.half_width, 3)}` : "–", number(source.largest_gap, 2),
  ]));
  if (rows.length === 0) return;
  byId("phases").append(element("h3", {}, "Inertial navigation"),
    tableOf(["source", "fused", "refused", "unusable", "mean normalised square", "expected, 95 %", "largest gap, s"], rows));
}

function drawFaults() {
  const rows = flights.flatMap((flight) => flight.faults.map((fault) => [
    `${named(flight)}${fault.fault}`, label(fault.begins), fault.ends === null ? "for good" : label(fault.ends),
    fault.detection ? `after ${number(fault.detection.after, 3)} s, ${fault.detection.by}: ${fault.detection.sign}` : "not detected",
    number(fault.peak_error), number(fault.back_after, 3), fault.others,
  ]));
  if (rows.length === 0) return;
  byId("faults").append(element("h3", {}, "Planned faults"),
    tableOf(["fault", "from, s", "to, s", "noticed", "largest true error, m", "back after, s", "what the services did"], rows));
}

function drawFlown() {
  const facts = flights.map((flight) => {
    const run = flight.facts;
    return [flight.label, flight.seed, run?.host || "–", run?.outcome || (flight.broken ? "broken off" : "–"), label(flight.flown),
      run?.wall_seconds ? number(run.wall_seconds, 2) : "–",
      flight.topics.reduce((sum, { recorded }) => sum + recorded, 0).toLocaleString("en"),
      flight.topics.map(({ topic, not_flown, not_recorded }) => [not_flown + not_recorded, topic]).filter(([missing]) => missing > 0)
        .map(([missing, topic]) => `${missing} of ${topic}`).join(", ") || "none"];
  });
  byId("scenarios").append(tableOf(["flight", "seed", "host", "outcome", "flown, s", "wall time, s", "samples", "missing"], facts));
  for (const flight of flights) {
    byId("scenarios").append(element("details", {},
      element("summary", {}, isOne ? "The scenario, resolved" : `The scenario of ${flight.label}, resolved`), element("pre", {}, flight.scenario)));
  }
}

function drawFigures() {
  byId("drawings").hidden = data.figures.length === 0;
  for (const figure of data.figures) {
    const source = `data:image/svg+xml;base64,${figure.svg}`;
    byId("figures").append(element("figure", {},
      element("img", { src: source, alt: figure.title }),
      element("figcaption", {}, element("a", { href: source, download: figure.file }, figure.file))));
  }
}

/* ---- How the services kept time ---- */

function drawTiming() {
  const timed = flights.filter(({ facts }) => facts?.timing);
  byId("timing").hidden = timed.length === 0;
  for (const flight of timed) {
    flight.histograms.forEach((histogram) => drawHistogram(flight, histogram));
    drawQuantiles(flight);
  }
}

function drawQuantiles(flight) {
  const { services, capture_to_frame: chain } = flight.facts.timing;
  const micro = (quantiles) => (quantiles ? ["p50", "p90", "p99", "p999", "max"].map((name) => (1e6 * quantiles[name]).toFixed(0)).join(" / ") : "–");
  const rows = services.map((service) => [service.service, service.steps, service.missed_steps, service.late_inputs, service.stale_inputs, micro(service.wake), micro(service.step)]);
  byId("quantiles").append(
    ...(isOne ? [] : [element("h3", {}, flight.label)]),
    tableOf(["service", "steps", "missed", "late inputs", "stale inputs", "woke late by, µs", "step took, µs"], rows),
    element("p", { class: "hint" }, `Times: p50 / p90 / p99 / p99.9 / longest. From capture to frame: ${micro(chain)} µs.`));
}

/** Counts on a logarithmic scale, so that what is rare is seen; 0 is no bar. */
function drawHistogram(flight, { service, what, edges, counts }) {
  const first = Math.max(0, counts.findIndex((count) => count > 0) - 1);
  const last = Math.min(counts.length - 1, counts.findLastIndex((count) => count > 0) + 1);
  const shown = edges.slice(first, last + 1);
  const holder = element("div", { class: "panel" }, element("h3", {}, `${named(flight)}${service}: ${what}`, element("span", {}, "steps")));
  byId("histograms").append(holder);
  const bars = counts.slice(first, last + 1).map((count) => (count === 0 ? null : count));
  const inUnits = (seconds) => (seconds < 1e-3 ? `${label(seconds * 1e6)} µs` : seconds < 1 ? `${label(seconds * 1e3)} ms` : `${label(seconds)} s`);
  const [x, y] = axes({ is_logarithmic: true });
  const plot = new uPlot({
    width: holder.clientWidth - 18,
    height: 170,
    scales: {
      x: { time: false, distr: 3, range: () => [shown[0], shown.at(-1) * 1.26] },
      y: { distr: 3, range: (_, low, high) => [0.7, (high ?? 1) * 1.5] },
    },
    axes: [{ ...x, values: (_, values) => values.map((value) => (isPower(value) ? inUnits(value) : "")) }, y],
    series: [
      { label: "from", value: (_, value) => (value === null ? "–" : inUnits(value)) },
      { label: "steps", stroke: () => colorOf(flight.place), fill: () => `${colorOf(flight.place)}55`, width: 1, points: { show: false },
        paths: uPlot.paths.bars({ size: [0.95], align: 1 }), value: (plot, value) => (plot.cursor.left >= 0 ? value ?? 0 : "–") },
    ],
    cursor: { drag: { x: false, y: false } },
  }, [shown, bars], holder);
  histograms.push(plot);
}

const histograms = [];

/* ---- Beginning ---- */

function recolor() {
  flights.forEach((flight, place) => {
    flight.color = colorOf(place);
    flight.chip.style.setProperty("--flight", flight.color);
  });
  for (const plot of [...plots, ...histograms]) plot.redraw(false);
  orbit.draw();
}

function fit() {
  const isPrinted = document.documentElement.classList.contains("print");
  for (const plot of [...plots, ...histograms]) {
    plot.setSize({ width: isPrinted ? PRINTED_WIDTH : plot.root.parentElement.clientWidth - 18, height: plot.height });
  }
  orbit.draw();
}

function listen() {
  byId("whole").addEventListener("click", showAll);
  for (const id of ["from", "to"]) {
    byId(id).addEventListener("change", () => {
      const [from, to] = [byId("from").valueAsNumber, byId("to").valueAsNumber];
      if (from < to) show(from, to); else show(view.from, view.to);
    });
  }
  byId("moment").max = end;
  byId("moment").addEventListener("input", () => lookAt(byId("moment").valueAsNumber));
  byId("play").addEventListener("click", play);
  darkness.addEventListener("change", recolor);
  const printed = (is) => () => {
    document.documentElement.classList.toggle("print", is);
    for (const details of document.querySelectorAll("details")) details.open = is;
    recolor();
    fit();
  };
  addEventListener("beforeprint", printed(true));
  addEventListener("afterprint", printed(false));
  let width = innerWidth;
  addEventListener("resize", () => {
    if (innerWidth !== width) {
      width = innerWidth;
      fit();
    }
  });
}

drawHead();
drawChips();
flights.forEach((flight, place) => { flight.color = colorOf(place); });
const orbit = new Orbit(byId("orbit"), flights, () => ({
  grid: variable("--line"), faint: variable("--faint"), ink: variable("--ink"), bound: variable("--bound"), path: variable("--path"), fence: variable("--fault"),
}));
drawResults();
drawInnovations();
panelsToDraw().forEach(draw);
drawTiming();
drawMarkList();
drawFaults();
drawFigures();
drawFlown();
listen();
recolor();
showAll();
lookAt(0);

// The panels are drawn once this script has ended, and seen with the next frame.
requestAnimationFrame(() => performance.measure("report-drawn", "report-begins"));
