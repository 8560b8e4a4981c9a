// How many pixels this machine draws in time.

// Milliseconds between redraws that look smooth, over how many of them a pace is measured, and parts of the view's sides.
const SMOOTH = 33, MEASURED = 5, PARTS = [1, 0.75, 0.5, 0.35];
// Milliseconds before a size that was too slow is tried again.
const FORGOTTEN = 10000;

export class Pace {
  constructor() { Object.assign(this, { step: 0, last: 0, intervals: [], slowAt: -Infinity }); }

  get part() { return PARTS[this.step]; }

  // Notes an animation frame, and chooses how many pixels are drawn while the viewer moves.
  measure(now, moving) {
    if (moving) this.intervals.push(now - this.last);
    else this.intervals.length = 0;
    this.last = now;
    if (this.intervals.length < MEASURED) return;
    const middle = this.intervals.sort((a, b) => a - b)[MEASURED >> 1];
    this.intervals.length = 0;
    if (middle > SMOOTH && this.step + 1 < PARTS.length) {
      // What a redraw costs goes with the pixels.
      this.step = middle > 2 * SMOOTH ? PARTS.length - 1 : this.step + 1;
      this.slowAt = now;
    } else if (middle < SMOOTH / 1.5 && this.step && now - this.slowAt > FORGOTTEN) {
      this.step--;
    }
  }
}
