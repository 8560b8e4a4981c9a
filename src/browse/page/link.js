// The WebSocket to the bridge; one HTTP request after another where none can be opened.

import { decode, flat, inflate } from "./relief.js";
import { ofScene } from "./scene.js";

// Messages that are lost: told by `say`. A frame that arrived: `frame`. The connection is new, and knows no camera: `again`.
export class Link {
  constructor({ say, frame, again, others }) {
    Object.assign(this, { say, frame, again, others });
    this.socket = null;
    this.everOpened = false;
    this.byRequests = false;
    this.requested = false;
    // Frames that arrived.
    this.received = 0;
    // Cameras without an answer, by number: when they were sent, and what was asked.
    this.asked = new Map();
    this.newest = 0;
    // Bytes that arrived, with their times, and in all.
    this.arrived = [];
    this.total = 0;
    // Milliseconds on the way, there and back, without the service's and the bridge's; and until a frame is here.
    this.roundTrip = 0;
    this.latency = 150;
  }

  connect() {
    const address = new URL(ofScene("session"), location.href.split(/[?#]/)[0]);
    address.protocol = address.protocol.replace("http", "ws");
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => { this.everOpened = true; this.asked.clear(); this.again(); };
    this.socket.onmessage = ({ data }) => typeof data === "string" ? this.told(JSON.parse(data)) : this.take(data);
    this.socket.onclose = ({ code, reason }) => {
      if (!this.everOpened) return this.byRequests = true;
      this.say(reason || "the connection to argus is lost, trying again");
      // 1013: too many pages are open.
      setTimeout(() => this.connect(), code === 1013 ? 5000 : 1000);
    };
  }

  // Whether another camera can be sent now.
  get open() {
    if (this.byRequests) return !this.requested;
    return this.socket?.readyState === WebSocket.OPEN && !this.socket.bufferedAmount;
  }

  // Asks for a frame of a camera's fields. `note`: what the page knows of it.
  ask(camera, note) {
    this.asked.set(++this.newest, { at: performance.now(), ...note });
    if (this.byRequests) this.request(this.newest, camera);
    else this.tell({ camera: this.newest, ...camera });
  }

  // Ends the request of a viewer who was at rest: it moves on.
  hurry() {
    if (this.requested && this.patient) this.stop.abort();
  }

  tell(message) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  told({ refused, failed, trouble, viewers }) {
    if (viewers) this.others(viewers);
    if (refused) this.say(`${refused.field}: ${refused.reason}`);
    if (trouble) this.say(`${trouble}; trying again`);
    if (!failed) return;
    this.say(failed.reason);
    this.forget(failed.camera);
    if (failed.again && failed.camera === this.newest) setTimeout(() => failed.camera === this.newest && this.again(), 1000);
  }

  forget(number) {
    for (const camera of this.asked.keys()) if (camera <= number) this.asked.delete(camera);
  }

  async take(message) {
    this.count(message.byteLength);
    const length = new DataView(message).getUint32(0, true);
    const about = JSON.parse(new TextDecoder().decode(new Uint8Array(message, 4, length)));
    const jpeg = new Uint8Array(message, 4 + length, about.jpeg_bytes);
    await this.decoded(about, new Blob([jpeg], { type: "image/jpeg" }), new Uint8Array(message, 4 + length + about.jpeg_bytes), message.byteLength);
    this.tell({ shown: about.camera_seq });
  }

  async request(number, { eye, target, fov_deg, size, direct, deadline_ms }) {
    this.requested = true;
    this.stop = new AbortController();
    this.patient = !this.asked.get(number)?.moving;
    try {
      const soon = deadline_ms ? `&deadline_ms=${deadline_ms}` : "";
      const words = `eye=${eye}&target=${target}&fov_deg=${fov_deg}&size=${size.join("x")}${direct ? "&direct" : ""}${soon}`;
      const answer = await fetch(ofScene(`frame?${words}`), { signal: this.stop.signal });
      if (!answer.ok) throw new Error(await answer.text());
      const about = { ...JSON.parse(answer.headers.get("argus-frame")), camera_seq: number }, jpeg = await answer.blob();
      this.count(jpeg.size);
      await this.decoded(about, jpeg, null, jpeg.size);
    } catch (error) {
      if (!this.stop.signal.aborted) {
        this.say(error.message);
        await new Promise(done => setTimeout(done, 1000));
      }
      this.asked.clear();
      this.again();
    }
    this.requested = false;
  }

  async decoded(about, jpeg, relief, bytes) {
    const asked = this.asked.get(about.camera_seq);
    if (asked && !this.byRequests) {
      const way = performance.now() - asked.at - about.bridge_ms - about.jpeg_ms - about.relief_ms;
      this.roundTrip += (Math.max(0, way) - this.roundTrip) / 4;
    }
    try {
      const [image, planes] = await Promise.all([
        createImageBitmap(jpeg, { colorSpaceConversion: "none", premultiplyAlpha: "none" }), relief?.length ? inflate(relief) : null]);
      const { width, height } = image;
      const points = planes ? decode(planes, about.relief, width, height) : flat(width, height);
      this.received++;
      if (asked) this.frame({ about, image, points, asked, bytes });
      else image.close();
      if (asked) this.latency += (Math.min(2000, performance.now() - asked.at) - this.latency) / 4;
    } catch (error) {
      this.say(`an image cannot be decoded: ${error.message}`);
    }
    this.forget(about.camera_seq);
  }

  count(bytes) {
    this.arrived.push([performance.now(), bytes]);
    this.total += bytes;
  }

  // Bytes a second over the last two seconds.
  rate(now) {
    while (this.arrived.length && this.arrived[0][0] < now - 2000) this.arrived.shift();
    return this.arrived.reduce((sum, [, bytes]) => sum + bytes, 0) / 2;
  }
}
