// The page: each animation frame moves the viewer, redraws what is known from there, and asks for what is not.

import { readAddress, writeAddress } from "./address.js";
import { bound } from "./bound.js";
import { Compare } from "./compare.js";
import { listen, walkByKeys } from "./controls.js";
import { figures, showCells } from "./figures.js";
import { Link } from "./link.js";
import { Others } from "./others.js";
import { Pace } from "./pace.js";
import { Plain } from "./plain.js";
import { Requests } from "./request.js";
import { offerScenes, ofScene } from "./scene.js";
import { moves, note, pose, restedFor, stand, target, turn, viewer } from "./viewer.js";
import { Warp } from "./warp.js";

const at = id => document.getElementById(id);
const canvas = at("view"), words = new URLSearchParams(location.search);
const scene = { animated: false, effects: [], lightRises: false };
const shown = { images: 0, redraws: 0, at: 0, askedAt: 0, number: 0, about: null, size: [0, 0], bytes: 0, times: [], redrawn: [], bound: null, pose: null };
// Share of holes for which no other frame is drawn; their surroundings fill them.
const FEW = 0.003;
const pace = new Pace();
let lasting = "", arrived = null, before = performance.now(), figuresAt = 0;

const say = words => { at("error").textContent = words || lasting; };
// A page that was opened with ?plain is one without WebGL2.
const screen = (words.has("plain") ? null : Warp.on(canvas)) ?? new Plain(canvas);
const reprojects = () => screen instanceof Warp && at("reproject").checked;
const link = new Link({ say, again: () => requests.again(), others: viewers => others.know(viewers), frame: take });
const requests = new Requests(link);
const compare = new Compare(at("compare"), at("slider"), at("triangles"));
const others = new Others(at("others"), at("show-others"), link);

function take(frame) {
  if (frame.about.camera_seq < Math.max(shown.number, arrived?.about.camera_seq ?? 0)) return frame.image.close();
  arrived?.image.close();
  arrived = frame;
}

// Sets the canvas' pixels: fewer while the viewer moves, if this machine draws too slowly. Returns whether they changed.
function resize(full, moving) {
  const [width, height] = full.map(side => Math.round(side * (moving && reprojects() ? pace.part : 1)));
  if (canvas.width === width && canvas.height === height) return false;
  [canvas.width, canvas.height] = [width, height];
  return true;
}

// Takes the newest frame that arrived, if one did.
function install(now) {
  if (!arrived) return false;
  const { about, image, points, asked, bytes } = arrived;
  arrived = null;
  Object.assign(shown, { at: now, askedAt: asked.at, number: about.camera_seq, about, bytes, size: [image.width, image.height] });
  screen.take({ image, pose: asked.pose, points, relief: about.relief });
  if (screen instanceof Warp) image.close();
  shown.images++;
  shown.times.push(now);
  say("");
  return true;
}

// The frames that are drawn, the one with the least to get wrong first.
function ranked(here) {
  if (!reprojects()) return screen.frames.slice(0, 1);
  const bounds = new Map(screen.frames.map(frame => [frame, bound(frame, here, canvas.width, canvas.height)]));
  const frames = [...screen.frames].sort((a, b) => bounds.get(a).error - bounds.get(b).error);
  shown.bound = bounds.get(frames[0]) ?? null;
  // In a scene that moves, the older frame is of an earlier moment; and where hardly anything is missing, it is not needed.
  if (scene.animated || !shown.bound) return screen.frames.slice(0, 1);
  return shown.bound.holes + shown.bound.bare < FEW ? frames.slice(0, 1) : frames;
}

const same = (a, b) => a && a.yaw === b.yaw && a.pitch === b.pitch && a.fov === b.fov && a.eye.every((x, i) => x === b.eye[i]);

function redraw(now, isNew) {
  if (!screen.frames.length) return;
  const newest = screen.frames[0], here = reprojects() ? pose() : newest.pose;
  if (!isNew && same(shown.pose, here)) return;
  screen.draw(here, ranked(here));
  shown.pose = here;
  shown.redraws++;
  shown.redrawn.push(now);
}

const settings = () => ({ coarse: at("coarse").checked, direct: at("direct").checked, animated: scene.animated, reproject: reprojects() });
// A camera that stands still asks again until its image shows all light.
const lightMayBeBetter = now => scene.lightRises && !link.asked.size && shown.about && shown.about.light !== "full" && now - shown.at > 1000;

function tick(now) {
  walkByKeys(Math.min((now - before) / 1000, 0.25));
  before = now;
  note(now);
  const moving = scene.animated || moves(now);
  const full = at("size").value.split("x").map(Number);
  pace.measure(now, moving);
  const resized = screen.frames.length > 0 && resize(full, moving);
  redraw(now, install(now) || resized);
  requests.adapt(now, moving && at("coarse").checked, shown.images);
  if (!moving && lightMayBeBetter(now)) requests.again();
  requests.next(now, reprojects() ? ranked(pose())[0] : null, full, settings());
  compare.follow(now, moving, full);
  others.draw(now, canvas);
  if (now - figuresAt > 200) {
    figuresAt = now;
    figures(now, shown, link, { ...scene, speed: viewer.speed });
    if (!moving) writeAddress();
  }
  requestAnimationFrame(tick);
}

function start(about) {
  at("scene").textContent = `${about.name}, ${about.triangles.toLocaleString("en")} triangles`;
  if (about.light) at("scene").textContent += ` · light ${about.light}`;
  document.title = `${about.name} · Argus`;
  Object.assign(scene, { animated: about.animated, lightRises: about.light_rises, effects: about.effects.filter(row => row.on).map(row => row.effect) });
  at("effects").title = about.effects.map(row => `${row.effect}: ${row.on ? "on" : "off"}, ${row.why}`).join("\n");
  viewer.speed = Math.hypot(...about.max.map((x, i) => x - about.min[i])) / 20;
  offerScenes(at("scenes"), about.scenes, about.scene);
  about.cameras.forEach((named, i) => at("camera").add(new Option(named.name, i)));
  at("camera").addEventListener("change", () => { stand(about.cameras[at("camera").value].camera); canvas.focus(); });
  stand(about.cameras[0].camera);
  const read = () => say(lasting = readAddress());
  addEventListener("hashchange", read);
  read();
  listen(canvas, () => 1 / (screen.frames[0]?.middle || 1 / viewer.speed));
  showCells().catch(() => {});
  requestAnimationFrame(tick);
}

for (const box of ["direct", "reproject"]) if (words.has(box)) at(box).checked = words.get(box) !== "off";
if (!(screen instanceof Warp)) at("reproject").disabled = true;
if ([...at("size").options].some(({ value }) => value === words.get("size"))) at("size").value = words.get("size");
at("size").addEventListener("change", () => canvas.focus());
// What the canvas shows, as the address of a PNG.
function picture() {
  redraw(performance.now(), true);
  return canvas.toDataURL("image/png");
}

// For scripts: the state of the page.
globalThis.argus = { picture, viewer, shown, link, requests, screen, moves, restedFor, pose, target, turn };

// Starts, or asks for a token first.
async function enter() {
  const answer = await fetch(ofScene("scene"));
  at("login").hidden = answer.status !== 401;
  if (answer.ok) {
    link.connect();
    start(await answer.json());
  } else if (answer.status !== 401) {
    throw new Error(await answer.text());
  }
}

async function logIn(event) {
  event.preventDefault();
  const answer = await fetch("login", { method: "POST", body: at("token").value });
  at("token").value = "";
  say(answer.ok ? "" : await answer.text());
  if (answer.ok) await enter();
}

at("login").addEventListener("submit", event => logIn(event).catch(error => say(error.message)));
enter().catch(error => say(error.message));
