// Clock of the page, which determines the time that all plots and views show.

class Player {
  constructor(report) {
    const get = (name) => document.getElementById(name);
    Object.assign(this, { play: get("play"), slider: get("time"), clock: get("clock"), speed: get("speed"), zoom: get("zoom"), follow: get("follow"), state: get("state") });
    this.runs = readRuns(report);
    this.front = this.runs[0];
    const span = finiteRange(this.runs.map((run) => run.times));
    this.span = span[1] > span[0] ? span : [span[0], span[0] + 1];
    this.window = [...this.span]; // time range of the plots
    this.time = this.span[0];
    this.last = null; // [ms] time of the previous frame, while the player runs
    this.view = new TopView(get("top-view"), this.runs);
    this.plots = plotKinds(report).map((kind) => new Plot(kind, this.runs, this.window, get("plots"), (time) => this.seek(time)));
    this.missing = this.plots.filter((plot) => !plot.range).map((plot) => plot.kind.title);
    this.plots = this.plots.filter((plot) => plot.range);
    [this.slider.min, this.slider.max] = this.span;
    this.listen();
  }

  listen() {
    this.play.addEventListener("click", () => this.toggle());
    this.slider.addEventListener("input", () => this.seek(this.slider.valueAsNumber));
    this.zoom.addEventListener("change", () => { this.lookAt(); this.redraw(); });
    this.follow.addEventListener("change", () => this.show());
    document.addEventListener("keydown", (event) => this.onKey(event));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
    new ResizeObserver(() => this.redraw()).observe(document.querySelector("main"));
  }

  toggle() {
    if (this.last !== null) return this.pause();
    if (this.time >= this.span[1]) this.time = this.span[0];
    this.last = performance.now();
    this.play.textContent = "Pause";
    requestAnimationFrame((now) => this.advance(now));
  }

  pause() {
    this.last = null;
    this.play.textContent = "Play";
  }

  advance(now) {
    if (this.last === null) return;
    this.time = Math.min(this.time + Math.max(now - this.last, 0) * 1e-3 * Number(this.speed.value), this.span[1]);
    this.last = now;
    this.show();
    if (this.time >= this.span[1]) this.pause();
    else requestAnimationFrame((next) => this.advance(next));
  }

  seek(time) {
    this.time = Math.min(Math.max(time, this.span[0]), this.span[1]);
    this.show();
  }

  // The plots show a share of the time, centered on this moment except near the ends.
  lookAt() {
    const [from, until] = this.span;
    const width = (until - from) / Number(this.zoom.value);
    const start = Math.min(Math.max(this.time - width / 2, from), until - width);
    [this.window[0], this.window[1]] = [start, start + width];
  }

  zoomBy(places) {
    const last = this.zoom.options.length - 1;
    this.zoom.selectedIndex = Math.min(Math.max(this.zoom.selectedIndex + places, 0), last);
    this.zoom.dispatchEvent(new Event("change"));
  }

  // Keys have an effect unless the focused element uses them.
  onKey(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.target.closest("button, select, summary, input:not([type=range])") && !/^[0-9f+-]$/.test(event.key)) return;
    const isArrow = event.key === "ArrowLeft" || event.key === "ArrowRight";
    if (isArrow && event.target.closest(".scroll")) return;
    if (event.key === " ") this.toggle();
    else if (isArrow) this.step((event.key === "ArrowLeft" ? -1 : 1) * (event.shiftKey ? 10 : 1));
    else if (event.key === "f") this.follow.click();
    else if (event.key === "+" || event.key === "-") this.zoomBy(event.key === "+" ? 1 : -1);
    else if (this.runs[event.key - 1]) this.bringToFront(this.runs[event.key - 1]);
    else return;
    event.preventDefault();
  }

  step(stamps) {
    this.pause();
    const { times } = this.front;
    this.seek(times[Math.min(Math.max(indexAt(times, this.time) + stamps, 0), times.length - 1)]);
  }

  bringToFront(run) {
    this.front = run;
    const choice = document.querySelectorAll("#runs input")[run.number];
    if (choice) choice.checked = true;
    this.redraw();
  }

  // Redraws everything after a change of the size, the colors or the highlighted run.
  redraw() {
    this.colors = readColors();
    fillTopViewLegend(document.getElementById("top-view-legend"), this.runs, this.view, this.colors);
    for (const plot of this.plots) plot.draw(this.front, this.colors);
    this.show();
  }

  show() {
    if (this.time < this.window[0] || this.time > this.window[1]) {
      this.lookAt();
      for (const plot of this.plots) plot.draw(this.front, this.colors);
    }
    const i = indexAt(this.front.times, this.time);
    const clock = `${inDigits(this.time, 2)} s`;
    this.slider.value = this.time;
    this.slider.setAttribute("aria-valuetext", clock);
    this.clock.textContent = clock;
    const braking = this.front.wheels.map((name, wheel) => [name, brakeState(this.front, wheel, i)]);
    const on = braking.filter(([, state]) => state === "on").map(([name]) => name);
    const words = [`${inDigits(speedAt(this.front, i), 2)} m/s`, assistState(this.front, i)];
    if (this.front.columns.pedal[0][i] > 0) words.push(`braking: ${on.join(", ") || "no wheel"}`);
    this.state.textContent = words.filter(Boolean).join(" · ");
    this.view.draw(this.time, this.front, this.follow.checked, this.colors);
    for (const plot of this.plots) plot.show(this.time, this.front);
  }
}

function start() {
  const report = JSON.parse(document.getElementById("data").textContent);
  const names = report.runs.map((run) => run.name);
  document.title = report.title;
  document.getElementById("title").textContent = report.title;
  document.getElementById("subtitle").textContent = `On every time axis: ${report.timeLabel}.`;
  const player = new Player(report);
  const choices = document.getElementById("runs");
  choices.hidden = names.length < 2;
  for (const run of player.runs) {
    const label = element("label", {}, choices);
    const choice = element("input", { type: "radio", name: "run", checked: run === player.front }, label);
    choice.addEventListener("change", () => player.bringToFront(run));
    label.append(` ${run.name}`);
  }
  const notes = report.runs.flatMap((run) => run.notes.map((note) => `${run.name}: ${note}`));
  if (player.missing.length) notes.push(`Without data: ${player.missing.join(", ")}`);
  fillList(document.getElementById("notes"), notes);
  fillMetrics(report, names);
  for (const [name, png] of Object.entries(report.seen)) {
    const section = document.getElementById("seen");
    element("h3", { textContent: name }, section);
    const box = element("div", { className: "scroll", tabIndex: 0 }, section);
    element("img", { src: `data:image/png;base64,${png}`, alt: `Lines, displacements and correlations of ${name}` }, box);
    section.hidden = false;
  }
  fillConfiguration(report, names);
  player.follow.checked = matchMedia("(max-width: 40rem)").matches;
  player.redraw();
  return player;
}

const player = start();
