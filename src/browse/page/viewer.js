// The viewer: where it stands, how it moves, and where it will be.

// Eye in metres, yaw and pitch in radians, vertical field of view in degrees, speed in metres a second.
export const viewer = { eye: [0, 0, 0], yaw: 0, pitch: 0, fov: 60, speed: 1 };

// Milliseconds: over which a velocity is measured, and after its last change in which a viewer counts as moving.
const MEASURED = 120, REST = 150;
// Radians: a viewer does not look straight up or down, where its right is not defined.
const STEEPEST = 1.55;

let movedAt = -Infinity;
const track = [];

export const pose = () => ({ eye: [...viewer.eye], yaw: viewer.yaw, pitch: viewer.pitch, fov: viewer.fov });
export const moves = now => now - movedAt < REST;
// Milliseconds for which the viewer has stood still.
export const restedFor = now => now - movedAt;
const moved = () => { movedAt = performance.now(); };

// Right, up and ahead in world space.
export function axes({ yaw, pitch }) {
  const [sy, cy, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
  return [[cy, 0, sy], [-sy * sp, cp, cy * sp], [sy * cp, sp, -cy * cp]];
}

export const rounded = x => Number(x.toPrecision(9));
export const target = pose => pose.eye.map((x, i) => rounded(x + axes(pose)[2][i]));

export function stand({ eye, target, fov_deg }) {
  const to = target.map((x, i) => x - eye[i]), length = Math.hypot(...to) || 1;
  viewer.eye = [...eye];
  viewer.yaw = Math.atan2(to[0], -to[2]);
  viewer.pitch = Math.max(-STEEPEST, Math.min(STEEPEST, Math.asin(to[1] / length)));
  viewer.fov = fov_deg;
  track.length = 0;
}

export function walk(along, across, up) {
  const [right, , ahead] = axes(viewer);
  viewer.eye = viewer.eye.map((x, i) => x + along * ahead[i] + across * right[i] + (i === 1 ? up : 0));
  moved();
}

export function turn(yaw, pitch) {
  viewer.yaw += yaw;
  viewer.pitch = Math.max(-STEEPEST, Math.min(STEEPEST, viewer.pitch + pitch));
  moved();
}

// Turns about a point `distance` metres ahead.
export function orbit(yaw, pitch, distance) {
  walk(distance, 0, 0);
  turn(yaw, pitch);
  walk(-distance, 0, 0);
}

// Notes where the viewer is at this time.
export function note(now) {
  track.push({ now, ...pose() });
  while (track.length > 2 && track[1].now < now - MEASURED) track.shift();
}

// Where the viewer will be after some milliseconds, if it goes on as it did last.
export function expected(ms) {
  const [from, to] = [track[0], track.at(-1)], here = pose();
  if (!from || to.now - from.now < 20 || !moves(to.now)) return here;
  const on = ms / (to.now - from.now);
  here.eye = here.eye.map((x, i) => x + on * (to.eye[i] - from.eye[i]));
  here.yaw += on * (to.yaw - from.yaw);
  here.pitch = Math.max(-STEEPEST, Math.min(STEEPEST, here.pitch + on * (to.pitch - from.pitch)));
  return here;
}
