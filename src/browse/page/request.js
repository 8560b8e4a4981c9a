// When to ask for a frame, and for which: at once when what is shown may be wrong, coarse while the viewer moves, and one
// in full once it rests.

import { bound, fresh } from "./bound.js";
import { expected, moves, pose, restedFor, rounded, target, viewer } from "./viewer.js";

// Frames a second below which smaller ones are asked for while the viewer moves; redraws fill the time between them.
const ENOUGH = 4;
// Sizes of frames while the viewer moves, as fractions of the full size's sides.
const FRACTIONS = [1, 0.75, 0.5];
// Milliseconds: over which a rate is judged; before a size that was too slow is tried again; and that a frame may take while
// the viewer moves. The service shows as much detail as it can by then.
const JUDGED = 700, FORGOTTEN = 10000, SOON = 150;
// Milliseconds that a frame of the full size may take while the viewer may go on at once, and after which it has come to rest:
// then a frame is asked for that may take as long as it does.
const PROMPT = 250, RESTED = 800;
// Milliseconds between two cameras, at least.
const PAUSE = 30;
// Error above that of a new frame from which a frame is asked for.
const WORSE = 0.01;
// Border around the view, as a share of its height: while the viewer moves, and at rest.
const BORDERS = { moving: 0.1, resting: 0.04 };
// JPEG quality while the viewer moves, and at rest.
const QUALITIES = { moving: 75, resting: 90 };
// Seconds of walking that planes are good for.
const REACH = 0.5;

export class Requests {
  constructor(link) {
    Object.assign(this, { link, said: "", sentAt: 0, fraction: 2, judgedFrom: 0, before: 0, tooSlowAt: [] });
  }

  // The next frame is asked for, whatever was.
  again() { this.said = ""; }

  // Chooses the size of frames while the viewer moves.
  adapt(now, moving, images) {
    if (!moving || !images) return this.judgedFrom = 0;
    if (!this.judgedFrom) return this.judgedFrom = now, this.before = images;
    if (now - this.judgedFrom < JUDGED) return;
    const rate = (images - this.before + 1) * 1000 / (now - this.judgedFrom);
    if (rate < ENOUGH && this.fraction + 1 < FRACTIONS.length) this.tooSlowAt[this.fraction++] = now;
    else if (rate >= 2 * ENOUGH && this.fraction && !(now - this.tooSlowAt[this.fraction - 1] < FORGOTTEN)) this.fraction--;
    this.judgedFrom = now, this.before = images;
  }

  // Asks, if it is time. `shown`: the frame that is drawn, if any; `full`: pixels of the view; `wanted`: the settings.
  next(now, shown, full, { coarse, direct, animated, reproject }) {
    if (moves(now)) this.link.hurry();
    if (!this.link.open) return;
    // The first frame, too, is soon there rather than good.
    const moving = animated || moves(now) || !this.link.received, part = moving && coarse ? FRACTIONS[this.fraction] : 1;
    const seen = moving && reproject ? expected(this.link.latency) : pose();
    if (moving && reproject && !animated && shown) {
      const [here, there] = [pose(), seen].map(pose => bound(shown, pose, ...full).error);
      if (Math.max(here, there) < fresh(part) + WORSE) return;
    }
    if (moving && this.said && now - this.sentAt < PAUSE) return;
    const camera = this.camera(seen, full, part, moving, restedFor(now) > RESTED, { coarse, direct, reproject });
    // Nothing new is to be expected of a camera that stands still, unless something moves.
    const said = JSON.stringify(camera);
    if (said === this.said && !(animated && !this.link.asked.size)) return;
    this.said = said;
    this.sentAt = now;
    const [width, height] = camera.size;
    this.link.ask(camera, { pose: { ...seen, fov: camera.fov_deg }, full, moving, width, height });
  }

  camera(seen, [width, height], part, moving, rested, { coarse, direct, reproject }) {
    const kind = moving ? "moving" : "resting";
    // Whole pixels on each side, so that a frame at rest is drawn pixel by pixel.
    const border = reproject ? Math.round(BORDERS[kind] * height) : 0;
    const size = [width, height].map(side => Math.max(1, Math.round((side + 2 * border) * part)));
    const tangent = Math.tan(seen.fov * Math.PI / 360) * (1 + 2 * border / height);
    const camera = {
      eye: seen.eye.map(rounded), target: target(seen), fov_deg: 2 * Math.atan(tangent) * 180 / Math.PI, size, direct,
    };
    if (reproject) Object.assign(camera, { quality: QUALITIES[kind], reach: Math.max(1e-3, rounded(REACH * viewer.speed)) });
    if (coarse && !direct && (moving || !rested)) camera.deadline_ms = moving ? SOON : PROMPT;
    return camera;
  }
}
