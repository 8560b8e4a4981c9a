// The other viewers of the service's page, as small frusta.

import { axes, pose, rounded, target, viewer } from "./viewer.js";
import { tangents } from "./warp.js";

// Metres that a frustum is long, as a share of what the viewer walks in a second; and milliseconds between two tellings.
const LENGTH = 0.15, PAUSE = 200;
// Near the eye, lines are cut.
const NEAREST = 0.05;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export class Others {
  constructor(canvas, box, link) {
    Object.assign(this, { canvas, box, link, viewers: [], drawn: "", toldAt: 0, told: "" });
    box.addEventListener("change", () => { this.viewers = []; this.told = ""; });
  }

  know(viewers) { this.viewers = this.box.checked ? viewers : []; }

  // Tells where this viewer is, and draws where the others are. Whoever asks to see the others is seen by them.
  draw(now, { width, height }) {
    const here = pose();
    if (now - this.toldAt > PAUSE) {
      const message = JSON.stringify({ seen: this.box.checked ? { eye: here.eye.map(rounded), target: target(here), fov_deg: here.fov } : null });
      const idle = !this.box.checked && (this.told === "" || this.told === message);
      if (!idle && message !== this.told && this.link.open && !this.link.byRequests) {
        this.link.tell(JSON.parse(message));
        this.told = message;
        this.toldAt = now;
      }
    }
    const picture = JSON.stringify([here, this.viewers, width, height]);
    if (picture === this.drawn) return;
    this.drawn = picture;
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    const paint = this.canvas.getContext("2d");
    paint.clearRect(0, 0, width, height);
    paint.strokeStyle = paint.fillStyle = "#fc6";
    paint.lineWidth = 2;
    this.viewers.forEach(other => this.frustum(paint, other, here, width, height));
  }

  frustum(paint, { eye, target, fov_deg, name }, here, width, height) {
    const to = target.map((x, i) => x - eye[i]), length = Math.hypot(...to);
    const looks = { yaw: Math.atan2(to[0], -to[2]), pitch: Math.asin(to[1] / length) };
    const [right, up, ahead] = axes(looks), [tx, ty] = tangents({ fov: fov_deg }, 4, 3), size = LENGTH * viewer.speed;
    const corner = (x, y) => eye.map((e, i) => e + size * (ahead[i] + x * tx * right[i] + y * ty * up[i]));
    const base = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => corner(x, y));
    const [mine, tangent] = [axes(here), tangents(here, width, height)];
    const seen = point => mine.map(axis => dot(axis, point.map((x, i) => x - here.eye[i])));
    const line = (a, b) => {
      let [from, to] = [seen(a), seen(b)];
      if (from[2] < to[2]) [from, to] = [to, from];
      if (from[2] <= NEAREST) return;
      if (to[2] < NEAREST) {
        const share = (from[2] - NEAREST) / (from[2] - to[2]);
        to = from.map((x, i) => x + share * (to[i] - x));
      }
      const place = ([x, y, z]) => [(1 + x / z / tangent[0]) * width / 2, (1 - y / z / tangent[1]) * height / 2];
      paint.beginPath();
      paint.moveTo(...place(from));
      paint.lineTo(...place(to));
      paint.stroke();
      return place(from);
    };
    base.forEach((point, i) => { line(eye, point); line(point, base[(i + 1) % 4]); });
    const label = line(base[2], base[3]);
    if (label) paint.fillText(name, ...label);
  }
}
