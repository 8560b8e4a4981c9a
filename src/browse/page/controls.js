// Pointers and keys: fly, look, orbit and pinch.

import { orbit, turn, viewer, walk } from "./viewer.js";

const pressed = new Set(), pointers = new Map();
let orbits = false;

// Moves the viewer by the keys that are held.
export function walkByKeys(seconds) {
  const held = (...keys) => keys.some(key => pressed.has(key)) ? 1 : 0;
  const along = held("w", "arrowup") - held("s", "arrowdown");
  const across = held("d", "arrowright") - held("a", "arrowleft");
  const up = held("e") - held("q");
  const step = viewer.speed * seconds;
  if (along || across || up) walk(step * along, step * across, step * up);
}

function apart() {
  const [[x1, y1], [x2, y2]] = pointers.values();
  return Math.hypot(x1 - x2, y1 - y2) || 1;
}

// Listens to a canvas. `distance()`: metres to what is in the middle of the view, about which it orbits.
export function listen(canvas, distance) {
  canvas.addEventListener("pointerdown", event => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    orbits = event.button === 2 || event.shiftKey;
    canvas.focus();
  });
  canvas.addEventListener("pointermove", event => {
    const from = pointers.get(event.pointerId);
    if (!from) return;
    const before = pointers.size === 2 ? apart() : 0;
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    const radians = viewer.fov * Math.PI / 180 / canvas.clientHeight;
    const [right, down] = [(event.clientX - from[0]) * radians, (event.clientY - from[1]) * radians];
    if (pointers.size === 1) orbits ? orbit(3 * right, -3 * down, distance()) : turn(-right, down);
    if (before) walk(2 * viewer.speed * Math.log(apart() / before), 0, 0);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, event => pointers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", event => event.preventDefault());
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    viewer.speed *= Math.exp(-event.deltaY / 500);
  }, { passive: false });
  addEventListener("keydown", event => {
    const types = ["SELECT", "INPUT"].includes(event.target.tagName);
    if (!types && !event.ctrlKey && !event.metaKey) pressed.add(event.key.toLowerCase());
  });
  addEventListener("keyup", event => pressed.delete(event.key.toLowerCase()));
  addEventListener("blur", () => pressed.clear());
}
