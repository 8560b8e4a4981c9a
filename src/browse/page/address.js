// The view in the page's address: #eye=0,1,5&target=0,1,4&fov_deg=60

import { pose, rounded, stand, target, viewer } from "./viewer.js";

let written = "", wrong = "";
const point = numbers => numbers.length === 3 && numbers.every(Number.isFinite);

// Stands where the address says. Returns what is wrong with it, "" for nothing.
export function readAddress() {
  wrong = "";
  if (location.hash.length < 2) return wrong;
  const words = new URLSearchParams(location.hash.slice(1));
  const numbers = name => (words.get(name) ?? "").split(",").map(text => text.trim() === "" ? NaN : Number(text));
  const [eye, target, [fov_deg]] = [numbers("eye"), numbers("target"), words.has("fov_deg") ? numbers("fov_deg") : [60]];
  const field = !point(eye) ? "eye" : !point(target) ? "target" : !(fov_deg > 0 && fov_deg < 180) ? "fov_deg" : "";
  wrong = field && `the view in the address is not understood: ${field}`;
  if (!wrong) stand({ eye, target, fov_deg });
  return wrong;
}

// Writes the view into the address, unless it holds one that was not understood.
export function writeAddress() {
  if (wrong) return;
  const hash = `#eye=${viewer.eye.map(rounded)}&target=${target(pose())}&fov_deg=${rounded(viewer.fov)}`;
  if (hash !== written) history.replaceState(null, "", written = hash);
}

addEventListener("hashchange", () => { written = location.hash; });
