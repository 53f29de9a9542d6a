// The vehicles from above: the highlighted run with all its data, the other runs faded.

const PALE = 0.4; // opacity of the runs that are not highlighted
const FOLLOWED_LENGTHS = 4; // chassis lengths across the picture that follows the vehicle
const POINT_SIZE = 1; // [m] size of a vehicle with unknown dimensions

class TopView {
  constructor(canvas, runs) {
    this.canvas = canvas;
    this.runs = runs;
    this.size = Math.max(...runs.map((run) => (run.scene ? run.scene.length : POINT_SIZE)));
    const reach = 0.5 * Math.max(
      ...runs.map((run) => (run.scene ? Math.hypot(run.scene.length, run.scene.width) : POINT_SIZE))
    ) + 0.3 * this.size;
    const [left, right] = finiteRange(runs.map((run) => run.columns.x[0])) || [0, 0];
    const [low, high] = finiteRange(runs.map((run) => run.columns.y[0])) || [0, 0];
    this.bounds = [left - reach, low - reach, right + reach, high + reach];
    this.topSpeed = Math.max(...runs.map((run) => Math.max(0, ...run.times.map((_, i) => speedAt(run, i) || 0))));
    this.topForce = Math.max(...runs.map((run) => (run.forces ? run.forces.largest : 0)));
  }

  draw(time, front, follow, colors) {
    const [left, low, right, high] = this.bounds;
    const across = this.canvas.getBoundingClientRect().width;
    const tallest = Math.min(0.45 * window.innerHeight, 460);
    const fitting = Math.min(Math.max((across * (high - low)) / (right - left), 190), tallest);
    const square = Math.min(0.75 * across, tallest);
    const { pen, width, height } = prepareCanvas(this.canvas, follow ? square : fitting);
    const pose = poseAt(front, time);
    const scale = follow
      ? Math.min(width, height * 1.6) / (FOLLOWED_LENGTHS * this.size)
      : Math.min(width / (right - left), height / (high - low));
    const [centerX, centerY] = follow ? [pose.x, pose.y] : [(left + right) / 2, (low + high) / 2];
    this.view = { pen, width, height, scale, centerX, centerY, colors };
    this.drawGround(front);
    const others = this.runs.filter((run) => run !== front);
    for (const run of others) {
      this.drawTrail(run, time, PALE);
      this.drawVehicle(run, time, PALE);
    }
    this.drawInitialLine(front);
    this.drawTrail(front, time, 1);
    this.drawVehicle(front, time, 1);
    this.drawArrows(front, time);
  }

  // Lets `draw` work in meters of the ground, x to the right and y up.
  inWorld(draw) {
    const { pen, width, height, scale, centerX, centerY } = this.view;
    pen.save();
    pen.translate(width / 2, height / 2);
    pen.scale(scale, -scale);
    pen.translate(-centerX, -centerY);
    draw(pen, 1 / scale); // the second is the length of a pixel
    pen.restore();
  }

  inBody(pose, draw) {
    this.inWorld((pen, pixel) => {
      pen.translate(pose.x, pose.y);
      pen.rotate(pose.yaw);
      draw(pen, pixel);
    });
  }

  drawGround(front) {
    const { pen, width, height, scale, centerX, centerY, colors } = this.view;
    const { ticks, step, digits } = roundTicks(centerX - width / scale / 2, centerX + width / scale / 2, width / 110);
    this.inWorld((world, pixel) => {
      const [low, high] = [centerY - height / scale / 2, centerY + height / scale / 2];
      world.strokeStyle = colors.rule;
      world.lineWidth = pixel;
      world.beginPath();
      for (const x of ticks) line(world, [x, low], [x, high]);
      const reach = width / scale;
      for (const y of multiples(step, low, high)) line(world, [centerX - reach, y], [centerX + reach, y]);
      world.stroke();
      for (const patch of front.scene ? front.scene.patches : []) {
        polygon(world, patch.outline);
        world.globalAlpha = 0.15 + 0.4 * (1 - Math.min(Math.max(patch.friction, 0), 1));
        world.fillStyle = colors.slippery;
        world.fill();
        world.globalAlpha = 1;
        world.strokeStyle = colors.slippery;
        world.setLineDash([6 * pixel, 3 * pixel]);
        world.stroke();
        world.setLineDash([]);
      }
    });
    pen.fillStyle = colors.quiet;
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "center";
    for (const x of ticks) {
      const place = width / 2 + (x - centerX) * scale;
      if (place > 20 && place < width - 30) pen.fillText(`${inDigits(x, digits)} m`, place, height - 6);
    }
  }

  drawTrail(run, time, opacity) {
    const last = indexAt(run.times, time);
    const [x, y] = [run.columns.x[0], run.columns.y[0]];
    const here = poseAt(run, time);
    this.inWorld((pen, pixel) => {
      pen.strokeStyle = this.view.colors.ink;
      const stroke = (from, to, end, strength, width) => {
        pen.globalAlpha = opacity * strength;
        pen.lineWidth = width * pixel;
        pen.beginPath();
        for (let i = from; i <= to; i++) pen.lineTo(x[i], y[i]);
        if (end) pen.lineTo(end.x, end.y);
        pen.stroke();
      };
      stroke(0, x.length - 1, null, 0.35, 1);
      stroke(0, last, here, 1, 2);
    });
  }

  // Line of motion at the start of braking.
  drawInitialLine(run) {
    const i = run.brakeStart;
    if (i === null || !(speedAt(run, i) > 0)) return;
    const yaw = run.columns.yaw[0][i] + Math.atan2(run.columns.velocity[1][i], run.columns.velocity[0][i]);
    const from = [run.columns.x[0][i], run.columns.y[0][i]];
    const far = 2 * Math.hypot(this.bounds[2] - this.bounds[0], this.bounds[3] - this.bounds[1]);
    this.inWorld((pen, pixel) => {
      pen.strokeStyle = this.view.colors.quiet;
      pen.lineWidth = pixel;
      pen.setLineDash([8 * pixel, 5 * pixel]);
      pen.beginPath();
      line(pen, from, [from[0] + far * Math.cos(yaw), from[1] + far * Math.sin(yaw)]);
      pen.stroke();
    });
  }

  drawVehicle(run, time, opacity) {
    const { colors } = this.view;
    const i = indexAt(run.times, time);
    this.inBody(poseAt(run, time), (pen, pixel) => {
      pen.globalAlpha = opacity;
      pen.lineWidth = 1.5 * pixel;
      pen.strokeStyle = colors.ink;
      if (!run.scene) {
        polygon(pen, [[0.5, 0], [-0.5, 0.3], [-0.5, -0.3]].map(([x, y]) => [x * POINT_SIZE, y * POINT_SIZE]));
        pen.fillStyle = colors.chassis;
        pen.fill();
        pen.stroke();
        return;
      }
      const { length, width, center, wheels, load, loadArm, centerOfGravity } = run.scene;
      pen.fillStyle = colors.chassis;
      const corner = [center[0] - length / 2, center[1] - width / 2];
      pen.fillRect(...corner, length, width);
      pen.strokeRect(...corner, length, width);
      pen.fillStyle = colors.ink;
      polygon(pen, [[0.48, 0], [0.38, 0.06], [0.38, -0.06]].map(([x, y]) => [center[0] + x * length, center[1] + y * length]));
      pen.fill();
      wheels.forEach((wheel, number) => this.drawWheel(pen, pixel, wheel, brakeState(run, number, i), brakeShare(run, number, i)));
      if (loadArm) {
        pen.beginPath();
        line(pen, ...loadArm);
        pen.stroke();
      }
      if (load) disc(pen, load, 0.05 * length, colors.quiet, colors.ink);
      if (centerOfGravity) cross(pen, centerOfGravity, 0.05 * length, 2.5 * pixel);
    });
  }

  // Opacity is the brake enable, and released wheels are hollow, so that color is not the only cue.
  drawWheel(pen, pixel, wheel, state, share) {
    const { colors } = this.view, alpha = pen.globalAlpha;
    polygon(pen, wheel.outline);
    pen.fillStyle = colors.paper;
    pen.fill();
    pen.fillStyle = colors.braking;
    pen.globalAlpha = alpha * share;
    pen.fill();
    pen.globalAlpha = alpha;
    pen.lineWidth = (state === "released" ? 3 : 1.5) * pixel;
    pen.strokeStyle = state === "released" ? colors.released : colors.ink;
    pen.stroke();
    const reach = 0.6 * wheel.radius;
    const [x, y] = wheel.position;
    pen.strokeStyle = colors.ink;
    pen.lineWidth = 1.5 * pixel;
    pen.beginPath();
    line(pen, [x - reach * wheel.active[0], y - reach * wheel.active[1]],
      [x + reach * wheel.active[0], y + reach * wheel.active[1]]);
    pen.stroke();
  }

  drawArrows(run, time) {
    const { colors } = this.view;
    const i = indexAt(run.times, time);
    const velocity = run.columns.velocity.map((column) => column[i]);
    this.inBody(poseAt(run, time), (pen, pixel) => {
      if (this.topSpeed > 0) arrow(pen, pixel, [0, 0], velocity, (1.2 * this.size) / this.topSpeed, colors.speed);
      if (!run.forces || !run.scene || !(this.topForce > 0) || run.forces.times[0] > time) return;
      const k = indexAt(run.forces.times, time);
      run.scene.wheels.forEach((wheel, number) => {
        const { x, y } = run.forces.wheels[number];
        arrow(pen, pixel, wheel.position, [x[k], y[k]], (0.8 * this.size) / this.topForce, colors.ink);
      });
    });
  }
}

function line(pen, from, to) {
  pen.moveTo(...from);
  pen.lineTo(...to);
}

function polygon(pen, corners) {
  pen.beginPath();
  for (const corner of corners) pen.lineTo(...corner);
  pen.closePath();
}

function disc(pen, [x, y], radius, fill, edge) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fillStyle = fill;
  pen.fill();
  pen.strokeStyle = edge;
  pen.stroke();
}

function cross(pen, [x, y], reach, width) {
  pen.lineWidth = width;
  pen.beginPath();
  line(pen, [x - reach, y], [x + reach, y]);
  line(pen, [x, y - reach], [x, y + reach]);
  pen.stroke();
}

// An arrow along (x, y), `scale` meters of ground per unit; no arrow if it would be a dot.
function arrow(pen, pixel, [fromX, fromY], [x, y], scale, color) {
  const length = Math.hypot(x, y) * scale;
  if (!(length > 4 * pixel)) return;
  const head = Math.min(9 * pixel, length);
  pen.save();
  pen.translate(fromX, fromY);
  pen.rotate(Math.atan2(y, x));
  pen.strokeStyle = pen.fillStyle = color;
  pen.lineWidth = 2.5 * pixel;
  pen.beginPath();
  line(pen, [0, 0], [length - head, 0]);
  pen.stroke();
  polygon(pen, [[length, 0], [length - head, 0.45 * head], [length - head, -0.45 * head]]);
  pen.fill();
  pen.restore();
}
