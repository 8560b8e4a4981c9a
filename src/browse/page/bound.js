// What a redraw of a frame may have wrong, before it is drawn.

import { axes } from "./viewer.js";
import { tangents } from "./warp.js";

// Weights of what is wrong, as shares of the view: a pixel by which planes are off, and a halving of resolution.
const PIXEL = 0.01, BLUR = 0.04;
// Directions of a view that are looked up, in each axis, as shares of half its side.
const PROBES = [-1, -0.5, 0, 0.5, 1];

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// The bound of a frame seen from a pose on so many pixels:
// - `pixels`: how far planes are off, at most, by the relief's residual.
// - `bare`: the share of the view of which the frame shows nothing, at its median depth.
// - `holes`: the share that something nearer hid from the frame's eye, by the sum of its jumps in depth.
// - `blur`: halvings of resolution, at its median depth.
// - `error`: these together, comparable between frames.
export function bound(frame, pose, width, height) {
  const tangent = tangents(pose, width, height), focal = height / 2 / tangent[1], from = frame.height / 2 / frame.tangent[1];
  const apart = pose.eye.map((x, i) => x - frame.pose.eye[i]), moved = Math.hypot(...apart);
  const { residual, jumps, torn, median } = frame.relief ?? { residual: 1, jumps: 0, torn: 0, median: 1 };
  const source = axes(frame.pose), [right, up, ahead] = axes(pose);
  let missed = 0;
  for (const x of PROBES) for (const y of PROBES) {
    const ray = ahead.map((a, i) => a + x * tangent[0] * right[i] + y * tangent[1] * up[i]);
    const seen = ray.map((r, i) => r + median * apart[i]);
    const depth = dot(source[2], seen), slack = 1.001;
    const inside = depth > 0 && Math.abs(dot(source[0], seen)) <= slack * depth * frame.tangent[0] && Math.abs(dot(source[1], seen)) <= slack * depth * frame.tangent[1];
    if (!inside) missed++;
  }
  const nearer = Math.max(0.1, 1 - median * dot(source[2], apart));
  const pixels = focal * moved * residual, bare = missed / PROBES.length ** 2;
  const holes = torn + from * moved * jumps / (frame.width * frame.height);
  const blur = Math.max(0, Math.log2(focal / from / nearer) - 0.01);
  return { pixels, bare, holes, blur, error: PIXEL * pixels + bare + holes + BLUR * blur };
}

// The error of a new frame whose sides are this fraction of the view's.
export const fresh = fraction => -BLUR * Math.log2(fraction);
