"use strict";

/**
 * The 3D view, drawn with equal axes on a canvas, that turns with the mouse.
 *
 * The world's z points down, so up is −z. A flight is { color, shown, places: [{ time, position, desired, attitude }] },
 * all in m and rad; one that goes on also has its whole path, in points, and one with an envelope its box. What is outside the
 * view's stretch of time is drawn faintly.
 */
class Orbit {
  static START = { azimuth: -0.9, elevation: 0.45, distance: 1 };

  constructor(canvas, flights, colors) {
    Object.assign(this, { canvas, flights, colors, moment: 0, view: [-Infinity, Infinity] }, Orbit.START);
    this.measure();
    this.listen();
  }

  /** Takes in all places and paths that there are. */
  measure() {
    this.bounds = boundsOf(this.flights);
    this.extent = Math.max(0.5, ...this.bounds.map(([low, high]) => high - low));
    this.step = niceStep(this.extent / 4);
    this.box = this.bounds.map(([low, high]) => [Math.floor(low / this.step) * this.step, Math.ceil(high / this.step) * this.step]);
    this.box[2][1] = this.bounds[2][1];
    this.center = this.box.map(([low, high]) => (low + high) / 2);
    // As large as fits, with room for what is written beside it; as it is turned its size stays.
    const corners = this.box[0].flatMap((x) => this.box[1].flatMap((y) => this.box[2].map((z) => this.seen([x, y, z]))));
    this.reach = [0, 1].map((axis) => Math.max(...corners.map((corner) => Math.abs(corner[axis]))) + 0.6 * this.step);
  }

  /** Whether a point is where the view shows it. */
  holds(point) {
    return point.every((value, axis) => !Number.isFinite(value) || (value >= this.bounds[axis][0] && value <= this.bounds[axis][1]));
  }

  listen() {
    const { canvas } = this;
    let from = null;
    canvas.addEventListener("pointerdown", (event) => {
      from = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (from === null) return;
      this.turn((event.clientX - from[0]) * 0.008, (event.clientY - from[1]) * 0.008);
      from = [event.clientX, event.clientY];
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { from = null; });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.approach(Math.exp(event.deltaY * 0.001));
    }, { passive: false });
    canvas.addEventListener("dblclick", () => { Object.assign(this, Orbit.START); this.draw(); });
    canvas.addEventListener("keydown", (event) => {
      const action = {
        ArrowLeft: () => this.turn(-0.1, 0), ArrowRight: () => this.turn(0.1, 0),
        ArrowUp: () => this.turn(0, -0.1), ArrowDown: () => this.turn(0, 0.1),
        "+": () => this.approach(0.9), "=": () => this.approach(0.9), "-": () => this.approach(1.1),
        Home: () => { Object.assign(this, Orbit.START); this.draw(); },
      }[event.key];
      if (action) { event.preventDefault(); action(); }
    });
  }

  turn(azimuth, elevation) {
    this.azimuth += azimuth;
    this.elevation = Math.min(1.55, Math.max(-1.55, this.elevation + elevation));
    this.draw();
  }

  approach(factor) {
    this.distance = Math.min(5, Math.max(0.05, this.distance * factor));
    this.draw();
  }

  /** How far right of the middle and above it a point of the world is seen, m: parallel, so that equal lengths look equal. */
  seen([x, y, z]) {
    const [dx, dy, up] = [x - this.center[0], y - this.center[1], this.center[2] - z];
    const [sin, cos] = [Math.sin(this.azimuth), Math.cos(this.azimuth)];
    const right = dy * cos + dx * sin;
    const away = dx * cos - dy * sin;
    return [right, up * Math.cos(this.elevation) + away * Math.sin(this.elevation)];
  }

  pixel(point) {
    const [right, above] = this.seen(point);
    return [this.width / 2 + right * this.scale, this.height / 2 - above * this.scale];
  }

  draw() {
    const ratio = window.devicePixelRatio || 1;
    const { canvas } = this;
    [this.width, this.height] = [canvas.clientWidth, canvas.clientHeight];
    canvas.width = Math.round(this.width * ratio);
    canvas.height = Math.round(this.height * ratio);
    this.scale = Math.min(this.width / this.reach[0], this.height / this.reach[1]) / (1.75 * this.distance);
    this.pen = canvas.getContext("2d");
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.pen.lineJoin = "round";
    this.drawFloor();
    for (const flight of this.flights.filter((flight) => flight.shown && flight.envelope_box)) this.drawFence(flight.envelope_box);
    for (const flight of this.flights.filter((flight) => flight.shown)) this.drawWay(flight);
    for (const flight of this.flights.filter((flight) => flight.shown)) this.drawVehicle(flight);
  }

  /** A grid below all ways, with lengths along its near edges. */
  drawFloor() {
    const { step } = this;
    const [[x0, x1], [y0, y1], [top, floor]] = this.box;
    const colors = this.colors();
    this.pen.font = "11px system-ui, sans-serif";
    const ticks = (low, high) => Array.from({ length: Math.round((high - low) / step) + 1 }, (_, index) => low + index * step);
    for (const x of ticks(x0, x1)) this.line([[x, y0, floor], [x, y1, floor]], colors.grid, 1);
    for (const y of ticks(y0, y1)) this.line([[x0, y, floor], [x1, y, floor]], colors.grid, 1);
    const [cos, sin] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
    const nearX = cos > 0 ? x0 : x1;
    const nearY = sin > 0 ? y1 : y0;
    const out = step * 0.35;
    for (const x of ticks(x0, x1)) this.text(label(x), [x, nearY + (sin > 0 ? out : -out), floor], colors.faint);
    for (const y of ticks(y0, y1)) this.text(label(y), [nearX - (cos > 0 ? out : -out), y, floor], colors.faint);
    this.text("x, m", [(x0 + x1) / 2, nearY + (sin > 0 ? 3 * out : -3 * out), floor], colors.ink);
    this.text("y, m", [nearX - (cos > 0 ? 3 * out : -3 * out), (y0 + y1) / 2, floor], colors.ink);
    const corner = [cos > 0 ? x1 : x0, nearY];
    this.line([[...corner, floor], [...corner, top]], colors.grid, 1);
    for (const z of ticks(top, floor)) this.text(label(z), [...corner, z], colors.faint, 14);
    this.text("z, m", [...corner, top - step * 0.35], colors.ink, 14);
  }

  /** The envelope's box, as far as it is above the floor. */
  drawFence({ min, max }) {
    const bottom = Math.min(max[2], this.box[2][1]);
    const ring = (z) => [[min[0], min[1], z], [max[0], min[1], z], [max[0], max[1], z], [min[0], max[1], z], [min[0], min[1], z]];
    const { fence } = this.colors();
    const [above, below] = [ring(min[2]), ring(bottom)];
    for (const line of [above, below, ...above.map((corner, place) => [corner, below[place]])]) this.line(line, fence, 1.2, 0.7);
  }

  drawWay({ places, path, color }) {
    const [from, to] = this.view;
    const colors = this.colors();
    this.line(places.map(({ position }) => position), color, 1.5, 0.25);
    this.line(places.filter(({ time }) => time >= from && time <= to).map(({ position }) => position), color, 1.8);
    // On the way that covers it where the vehicle follows well, and in a colour that no flight has.
    this.pen.setLineDash([3, 4]);
    this.line(path ?? places.map(({ desired }) => desired), colors.path, 1.2);
    this.pen.setLineDash([]);
  }

  /** The vehicle at the moment: its arms, up, and a line to the point that it should be at. */
  drawVehicle({ places, color }) {
    const place = placeAt(places, this.moment);
    if (place === undefined) return;
    const colors = this.colors();
    const arm = this.extent * this.distance * 0.05;
    const axes = rotation(place.attitude);
    const at = (x, y, z) => place.position.map((value, row) => value + axes[row][0] * x + axes[row][1] * y + axes[row][2] * z);
    if (Number.isFinite(place.desired[0])) {
      this.line([place.position, place.desired], colors.bound, 1.5);
      this.dot(place.desired, 3.5, colors.bound);
    }
    const tip = arm * Math.SQRT1_2;
    this.line([at(tip, tip, 0), at(-tip, -tip, 0)], colors.ink, 3);
    this.line([at(tip, -tip, 0), at(-tip, tip, 0)], colors.ink, 3);
    this.line([at(0, 0, 0), at(0, 0, -arm)], color, 2.5);
    this.line([at(0, 0, 0), at(arm * 1.3, 0, 0)], color, 2.5);
    for (const [x, y] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) this.dot(at(x * tip, y * tip, 0), 3, color);
  }

  /** A line through points; it breaks where one is not known. */
  line(points, color, width, opacity = 1) {
    this.pen.globalAlpha = opacity;
    this.pen.strokeStyle = color;
    this.pen.lineWidth = width;
    this.pen.beginPath();
    let isDown = false;
    for (const point of points) {
      if (Number.isFinite(point[0])) {
        const [x, y] = this.pixel(point);
        if (isDown) this.pen.lineTo(x, y); else this.pen.moveTo(x, y);
        isDown = true;
      } else {
        isDown = false;
      }
    }
    this.pen.stroke();
    this.pen.globalAlpha = 1;
  }

  dot(point, radius, color) {
    const [x, y] = this.pixel(point);
    this.pen.fillStyle = color;
    this.pen.beginPath();
    this.pen.arc(x, y, radius, 0, 2 * Math.PI);
    this.pen.fill();
  }

  text(text, point, color, right = 0) {
    const [x, y] = this.pixel(point);
    this.pen.fillStyle = color;
    this.pen.textAlign = right ? "left" : "center";
    this.pen.textBaseline = "middle";
    this.pen.fillText(text, x + right, y);
  }
}

/** Largest size of the envelope's box that the view takes in, in sizes of the flight. */
const LARGEST_BOX = 6;

/** Least and greatest of each axis over all places, paths and boxes. */
function boundsOf(flights) {
  const bounds = [0, 1, 2].map(() => [Infinity, -Infinity]);
  const include = (point) => point.forEach((value, axis) => {
    if (!Number.isFinite(value)) return;
    bounds[axis] = [Math.min(bounds[axis][0], value), Math.max(bounds[axis][1], value)];
  });
  for (const { places, path } of flights) {
    for (const { position, desired } of places) [position, desired].forEach(include);
    (path ?? []).forEach(include);
  }
  // Of a box its bottom may be far below the floor, and a box that is much larger than the flight would hide it.
  const extent = Math.max(0.5, ...bounds.map(([low, high]) => high - low).filter(Number.isFinite));
  for (const { envelope_box: box } of flights) {
    if (!box || box.max.some((high, axis) => high - box.min[axis] > LARGEST_BOX * extent)) continue;
    include(box.min);
    include([box.max[0], box.max[1], NaN]);
  }
  return bounds.map(([low, high]) => (low <= high ? [low, high] : [-1, 1]));
}

/** The last place at or before a moment, or the first. */
function placeAt(places, moment) {
  let [low, high] = [0, places.length];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (places[middle].time <= moment) low = middle; else high = middle;
  }
  return places[low];
}

/** Body to world, from roll, pitch and yaw: Rz(yaw) Ry(pitch) Rx(roll). */
function rotation([roll, pitch, yaw]) {
  const [sr, cr] = [Math.sin(roll), Math.cos(roll)];
  const [sp, cp] = [Math.sin(pitch), Math.cos(pitch)];
  const [sy, cy] = [Math.sin(yaw), Math.cos(yaw)];
  return [
    [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
    [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
    [-sp, cp * sr, cp * cr],
  ];
}

/** 1, 2 or 5 times a power of ten, about as large as asked for. */
function niceStep(size) {
  const power = 10 ** Math.floor(Math.log10(size));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= size);
}

function label(value) {
  return String(Number(value.toFixed(6)));
}
