// The figures below the view.

import { ofScene } from "./scene.js";

const at = id => document.getElementById(id);

const LIGHT = {
  "direct": "direct light; light between surfaces is being prepared",
  "coarse": "light between surfaces, coarse; finer light is being prepared",
};
const WAYS = {
  "direct": "rendered from triangles",
  "samples": "composed from samples",
  "samples and rays": "composed from samples, holes traced",
  "frames": "warped from recent frames",
  "frames and rays": "warped from recent frames, holes traced",
};

// Events a second of the times of the last two seconds, or `null` if there were hardly any.
function rate(times, now) {
  while (times.length && times[0] < now - 2000) times.shift();
  return times.length > 2 ? (times.length - 1) * 1000 / (times.at(-1) - times[0]) : null;
}

export function figures(now, shown, link, { effects, lightRises, speed }) {
  const oldest = Math.min(...[...link.asked.values()].map(camera => camera.at)), waits = (now - oldest) / 1000;
  at("waiting").textContent = waits > 1 ? `waiting for an image for ${waits.toFixed(0)} s` : "";
  const { about } = shown, frames = rate(shown.times, now), redraws = rate(shown.redrawn, now), bytes = link.rate(now);
  if (!about) return;
  at("rate").textContent = frames === null && redraws === null ? "at rest" : `${(redraws ?? 0).toFixed(0)} redraws, ${(frames ?? 0).toFixed(1)} images a second`;
  at("way").textContent = WAYS[about.way] + (about.samples ? ` (${about.samples}, ${about.search})` : "") + (about.because ? `: ${about.because}` : "");
  at("unseen").textContent = about.samples ? `pixels that no sample saw: ${(100 * about.unresolved_fraction).toFixed(2)}%` : "";
  at("cost").textContent = `rendered in ${about.rendering_ms.toFixed(1)} ms`;
  at("cost").title = about.stages.map(({ name, ms }) => `${name}: ${ms.toFixed(1)} ms`).join("\n");
  const costs = effects.map(effect => effect in about.effects ? `${effect} ${about.effects[effect].toFixed(1)} ms` : effect);
  at("effects").textContent = costs.length ? `effects: ${costs.join(", ")}` : "";
  at("light").textContent = lightRises && about.light !== "full" ? LIGHT[about.light] : "";
  at("error_expected").textContent = about.predicted ? `expected error ${about.predicted.error.toFixed(3)} (mean FLIP)` : "";
  at("age").textContent = `image ${((now - shown.askedAt) / 1000).toFixed(1)} s old, round trip ${link.roundTrip.toFixed(0)} ms`;
  at("bytes").textContent = `${shown.size.join("×")}, ${(shown.bytes / 1000).toFixed(0)} kB, ${(bytes / 1000).toFixed(0)} kB a second`;
  at("bound").textContent = shown.bound ? `bound of the redraw: planes ${shown.bound.pixels.toFixed(1)} px, holes ${(100 * shown.bound.holes).toFixed(1)}%, bare ${(100 * shown.bound.bare).toFixed(0)}%` : "";
  at("speed").textContent = `speed ${Number(speed.toPrecision(2))} m/s`;
}

// Light cells of the whole service, every few seconds, unless its status is not for this page's user.
export async function showCells() {
  const answer = await fetch(ofScene("cells"));
  if (!answer.ok) return;
  const cells = await answer.json();
  setTimeout(() => showCells().catch(() => {}), 5000);
  at("cells").textContent = cells && `light cells lit ${(100 * cells.lit_share).toFixed(0)}% of pixels` + (cells.waiting ? `, ${cells.waiting} wait` : "");
  at("cells").title = cells && `${cells.pages} pages, ${(cells.bytes / 2 ** 20).toFixed(0)} MiB, ${(cells.fill_ms / 1000).toFixed(1)} s of filling`;
}
