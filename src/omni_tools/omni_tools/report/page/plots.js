// The plots over time. All share the player's time; the highlighted run is drawn over the others.

const MARGIN = { left: 46, right: 8, top: 6, bottom: 19 };
// Dash pattern by number of the color, because some readers cannot distinguish colors 3 and 4.
const DASHES = [[], [], [9, 3], [3, 2], [9, 2, 2, 2], [2, 4]];

// A curve has a label, times, values and the number of its color; `curves` returns a run's curves.
// A quantity with fewer samples than the other quantities is drawn as `dots`.
const PLOTS = [
  { name: "velocity", title: "Body velocity", unit: "m/s", digits: 2,
    curves: (run) => byComponent(run, "velocity", ["v_x", "v_y"]) },
  { name: "yaw-rate", title: "Yaw rate", unit: "rad/s", digits: 3,
    curves: (run) => byComponent(run, "yawRate", ["yaw rate"]) },
  { name: "heading", title: "Change of heading", unit: "deg", digits: 1,
    curves: (run) => byComponent(run, "heading", ["heading"]) },
  { name: "error", title: "Distance from the sliding manifold, s_i", unit: "m/s", digits: 3,
    curves: (run) => byWheel(run, run.columns.error) },
  { name: "test-ratio", title: "Fault detection: test ratio of each source", unit: "squared innovation over its gate; rejected above 1; cut off at 4", digits: 2, gate: 1, largest: 4,
    curves: (run) => namedCurves(run, "test_ratio") },
  { name: "enable", title: "Brake enables", unit: "filled height: share of the brake pressure", lanes: true,
    curves: (run) => byWheel(run, run.columns.enable) },
  { name: "slip", title: "Wheel slip", unit: "0 rolls, ±1 locked; computed", digits: 2,
    curves: (run) => byWheel(run, run.columns.slip) },
  { name: "force", title: "Wheel force along the active direction", unit: "N; dots: recorded samples", digits: 0, dots: true,
    curves: forceCurves },
  { name: "load", title: "Wheel load", unit: "N, computed", digits: 0,
    curves: (run) => byWheel(run, run.columns.load) },
  { name: "velocity-error", title: "Velocity, odometry minus truth", unit: "m/s", digits: 3,
    curves: (run) => byComponent(run, "velocityError", ["v_x", "v_y"]) },
  { name: "yaw-rate-error", title: "Yaw rate, odometry minus truth", unit: "rad/s", digits: 3,
    curves: (run) => byComponent(run, "yawRateError", ["yaw rate"]) },
];

function byComponent(run, name, labels) {
  return labels.map((label, color) => ({ label, color, times: run.times, values: run.columns[name][color] }));
}

function byWheel(run, columns) {
  return (columns || []).map((values, color) => ({ label: run.wheels[color], color, times: run.times, values }));
}

function forceCurves(run) {
  if (!run.forces || !run.scene) return [];
  return run.forces.wheels.map(({ x, y }, wheel) => {
    const [alongX, alongY] = run.scene.wheels[wheel].active;
    const values = x.map((force, i) => force * alongX + y[i] * alongY);
    return { label: run.wheels[wheel], color: wheel, times: run.forces.times, values };
  });
}

function namedCurves(run, name) {
  const { names, times, values } = run.series[name] || { names: [] };
  return names.map((label, color) => ({ label, color, times, values: values[color] }));
}

// The plots above, and a plot for each other recorded signal.
function plotKinds(report) {
  const others = Object.entries(report.signals).filter(([name]) => name !== "test_ratio");
  return [...PLOTS, ...others.map(([name, [title, unit]]) => (
    { name, title, unit, digits: 3, curves: (run) => namedCurves(run, name) }))];
}

class Plot {
  constructor(kind, runs, span, parent, onSeek) {
    this.kind = kind;
    this.runs = runs;
    this.span = span;
    this.curves = runs.map(kind.curves);
    this.range = this.valueRange();
    if (!this.range) return; // nothing recorded
    const figure = element("figure", { className: "plot", id: `plot-${kind.name}` }, parent);
    const title = element("h3", { textContent: `${kind.title} ` }, figure);
    element("small", { textContent: kind.unit }, title);
    this.box = element("div", { className: "curves" }, figure);
    this.canvas = element("canvas", {}, this.box);
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${kind.title}, ${kind.unit}, over time`);
    this.cursor = element("div", { className: "cursor" }, this.box);
    this.legend = element("ul", { className: "legend" }, figure);
    const seek = (event) => {
      const inside = (event.clientX - this.box.getBoundingClientRect().left - MARGIN.left) / this.width;
      onSeek(span[0] + Math.min(Math.max(inside, 0), 1) * (span[1] - span[0]));
    };
    this.box.addEventListener("pointerdown", (event) => {
      this.box.setPointerCapture(event.pointerId);
      seek(event);
    });
    this.box.addEventListener("pointermove", (event) => {
      if (event.buttons) seek(event);
    });
  }

  valueRange() {
    const found = finiteRange(this.curves.flat().map((curve) => curve.values));
    if (!found || this.kind.lanes) return found;
    const [low, high] = [found[0], Math.min(found[1], this.kind.largest ?? Infinity)];
    if (this.kind.gate) return [0, Math.max(1.1 * high, 1.2 * this.kind.gate)];
    const room = 0.06 * (high - low) || 0.5 * Math.abs(high) || 1;
    return [low - room, high + room];
  }

  // Draws everything except the cursor; needed after a change of size, colors or highlighted run.
  draw(front, colors) {
    const { pen, width, height } = prepareCanvas(this.canvas);
    pen.save();
    this.width = width - MARGIN.left - MARGIN.right;
    this.height = height - MARGIN.top - MARGIN.bottom;
    pen.translate(MARGIN.left, MARGIN.top);
    pen.font = "12px system-ui, sans-serif";
    pen.lineWidth = 1;
    this.drawAxes(pen, colors);
    pen.beginPath();
    pen.rect(0, 0, this.width, this.height);
    pen.clip();
    const others = this.runs.filter((run) => run !== front);
    for (const run of [...others, front]) {
      pen.globalAlpha = run === front ? 1 : PALE;
      pen.lineWidth = run === front ? 1.8 : 1.3;
      if (this.kind.lanes) this.drawLanes(pen, run, colors); else this.drawCurves(pen, run, colors);
    }
    pen.restore(); // otherwise, the clip and the dashes would affect the next drawing
    this.fillLegend(front, colors);
  }

  x(time) {
    return ((time - this.span[0]) / (this.span[1] - this.span[0])) * this.width;
  }

  y(value) {
    return ((this.range[1] - value) / (this.range[1] - this.range[0])) * this.height;
  }

  drawAxes(pen, colors) {
    pen.strokeStyle = colors.rule;
    pen.fillStyle = colors.quiet;
    pen.textAlign = "center";
    const along = roundTicks(...this.span, this.width / 60);
    for (const time of along.ticks) {
      const x = this.x(time);
      stroke(pen, [x, 0], [x, this.height]);
      if (x < this.width - 22) pen.fillText(inDigits(time, along.digits), x, this.height + 14);
    }
    pen.textAlign = "right";
    pen.fillText("s", this.width, this.height + 14);
    if (this.kind.lanes) return;
    const up = roundTicks(...this.range, this.height / 20);
    for (const value of up.ticks) {
      stroke(pen, [0, this.y(value)], [this.width, this.y(value)]);
      pen.fillText(inDigits(value, up.digits), -6, this.y(value) + 4);
    }
    pen.strokeStyle = colors.quiet; // zero, and the start of braking
    if (this.range[0] < 0 && this.range[1] > 0) stroke(pen, [0, this.y(0)], [this.width, this.y(0)]);
    if (!this.kind.gate) return;
    pen.strokeStyle = colors.ink;
    pen.setLineDash([6, 4]);
    stroke(pen, [0, this.y(this.kind.gate)], [this.width, this.y(this.kind.gate)]);
    pen.setLineDash([]);
  }

  drawCurves(pen, run, colors) {
    for (const { times, values, color } of this.curves[run.number]) {
      pen.strokeStyle = colors.series[color % colors.series.length];
      pen.setLineDash(this.kind.dots ? [] : DASHES[color % DASHES.length]);
      pen.beginPath();
      let drawing = false;
      for (let i = 0; i < times.length; i++) {
        const known = Number.isFinite(values[i]), place = [this.x(times[i]), this.y(values[i])];
        if (known && this.kind.dots) pen.rect(place[0] - 1, place[1] - 1, 2, 2);
        else if (known) pen[drawing ? "lineTo" : "moveTo"](...place);
        drawing = known;
      }
      pen.stroke();
    }
  }

  // A lane for each wheel, and in it a strip for each run; its filled height is the brake enable.
  drawLanes(pen, run, colors) {
    const curves = this.curves[run.number];
    const lane = this.height / curves.length;
    const strip = (0.8 * lane) / this.runs.length;
    curves.forEach(({ times, color }, wheel) => {
      const top = wheel * lane + 0.1 * lane + run.number * strip;
      pen.fillStyle = pen.strokeStyle = colors.series[color % colors.series.length];
      stroke(pen, [0, top + strip], [this.width, top + strip]);
      let from = 0, share = brakeShare(run, wheel, 0);
      for (let i = 1; i < times.length; i++) {
        const next = brakeShare(run, wheel, i);
        if (next === share && i < times.length - 1) continue;
        const left = this.x(times[from]);
        pen.fillRect(left, top + (1 - share) * strip, this.x(times[i]) - left, share * strip);
        [from, share] = [i, next];
      }
    });
  }

  fillLegend(front, colors) {
    this.legend.replaceChildren();
    this.values = this.curves[front.number].map(({ label, color }) => {
      const entry = element("li", {}, this.legend);
      swatch(entry, [["line", {
        x1: "0", y1: "6", x2: "23", y2: "6", "stroke-width": "3",
        stroke: colors.series[color % colors.series.length],
        "stroke-dasharray": this.kind.lanes || this.kind.dots ? "" : DASHES[color % DASHES.length].join(" "),
      }]]);
      entry.append(label);
      return element("span", { className: "value" }, entry);
    });
  }

  // Shows a time: the cursor, and the values of the highlighted run.
  show(time, front) {
    this.cursor.style.transform = `translateX(${MARGIN.left + this.x(time)}px)`;
    this.curves[front.number].forEach(({ times, values }, number) => {
      const i = indexAt(times, time);
      this.values[number].textContent = this.kind.lanes
        ? { on: onWords(brakeShare(front, number, i)), released: "released", up: "pedal up" }[brakeState(front, number, i)]
        : inDigits(values[i], this.kind.digits);
    });
  }
}

const onWords = (share) => (share < 1 ? `${Math.round(100 * share)} %` : "on");

function stroke(pen, from, to) {
  pen.beginPath();
  line(pen, from, to);
  pen.stroke();
}
