// Texts and tables of the page. Text from a recording is inserted by textContent only.

function element(tag, properties, parent) {
  const made = Object.assign(document.createElement(tag), properties);
  if (parent) parent.append(made);
  return made;
}

// Symbol of 24 x 12 px for a legend.
function swatch(parent, shapes) {
  const space = "http://www.w3.org/2000/svg";
  const picture = document.createElementNS(space, "svg");
  picture.setAttribute("viewBox", "0 0 24 12");
  picture.setAttribute("aria-hidden", "true");
  for (const [tag, attributes] of shapes) {
    const shape = document.createElementNS(space, tag);
    for (const [name, value] of Object.entries(attributes)) shape.setAttribute(name, value);
    picture.append(shape);
  }
  parent.append(picture);
}

function fillTopViewLegend(list, runs, view, colors) {
  const wheel = (attributes) => ["rect", { x: "3", y: "2", width: "18", height: "8", ...attributes }];
  const pointer = (color) => [
    ["line", { x1: "1", y1: "6", x2: "16", y2: "6", stroke: color, "stroke-width": "2.5" }],
    ["path", { d: "M23 6 15 2v8z", fill: color }],
  ];
  const dashes = (color) => [["line", { x1: "0", y1: "6", x2: "24", y2: "6", stroke: color, "stroke-dasharray": "6 3" }]];
  const entries = [[pointer(colors.speed), `velocity (longest ${inDigits(view.topSpeed, 1)} m/s)`]];
  if (runs.some((run) => run.scene)) {
    entries.unshift(
      [[wheel({ fill: colors.braking, stroke: colors.ink })], "brake on"],
      [[wheel({ fill: "none", stroke: colors.released, "stroke-width": "3" })], "released"],
      [[wheel({ fill: "none", stroke: colors.ink })], "pedal up"]
    );
  }
  if (view.topForce > 0) {
    entries.push([pointer(colors.ink), `force of a wheel when last recorded (longest ${inDigits(view.topForce / 1000, 1)} kN)`]);
  }
  if (runs.some((run) => run.scene && run.scene.load)) {
    entries.push([[["circle", { cx: "12", cy: "6", r: "5", fill: colors.quiet, stroke: colors.ink }]], "load"]);
  }
  if (runs.some((run) => run.scene && run.scene.centerOfGravity)) {
    entries.push([[["path", { d: "M6 6h12M12 0v12", stroke: colors.ink, "stroke-width": "2.5" }]], "center of gravity"]);
  }
  entries.push([dashes(colors.quiet), "line along the initial velocity"]);
  const patches = new Set(runs.flatMap((run) => (run.scene ? run.scene.patches : [])).map((patch) => patch.friction));
  for (const friction of patches) {
    entries.push([[wheel({ fill: colors.slippery, "fill-opacity": "0.5", stroke: colors.slippery })], `friction × ${friction}`]);
  }
  list.replaceChildren();
  for (const [shapes, words] of entries) {
    const entry = element("li", {}, list);
    swatch(entry, shapes);
    entry.append(words);
  }
}

function fillTable(parent, headings, rows, className) {
  const table = element("table", { className }, parent);
  const head = element("tr", {}, element("thead", {}, table));
  for (const heading of headings) element("th", { textContent: heading, scope: "col" }, head);
  const body = element("tbody", {}, table);
  for (const [name, ...cells] of rows) {
    const row = element("tr", {}, body);
    element("th", { textContent: name, scope: "row" }, row);
    for (const cell of cells) element("td", { textContent: cell ?? "–" }, row);
  }
  return table;
}

function fillMetrics(report, names) {
  const rows = report.metrics.map(({ label, unit, values }) => [label, unit, ...values]);
  const table = fillTable(document.getElementById("metrics"), ["", "unit", ...names], rows, "");
  for (const row of table.tBodies[0].rows) row.cells[1].className = "unit";
  fillList(document.getElementById("metric-notes"), report.metricNotes);
}

function fillConfiguration(report, names) {
  const rows = report.configuration.map(({ key, values }) => [key, ...values]);
  const different = rows.filter(([, first, ...others]) => others.some((value) => value !== first));
  const summary = document.getElementById("differences-summary");
  if (names.length > 1) {
    summary.textContent = different.length
      ? `${different.length} of ${rows.length} values differ:`
      : `All ${rows.length} values are the same.`;
  }
  if (different.length) fillTable(document.getElementById("differences"), ["", ...names], different, "values");
  document.getElementById("all-values-summary").textContent = `All ${rows.length} values`;
  fillTable(document.getElementById("all-values"), ["", ...names], rows, "values");
}

function fillList(list, texts) {
  for (const text of texts) element("li", { textContent: text }, list);
}
