// A slider between what is shown and the same view rendered from the triangles.

import { ofScene } from "./scene.js";
import { pose, rounded, target } from "./viewer.js";

export class Compare {
  constructor(box, slider, image) {
    Object.assign(this, { box, slider, image, shows: "", busy: false });
    slider.addEventListener("input", () => this.place());
    box.addEventListener("change", () => { this.shows = ""; });
  }

  place() {
    this.image.style.clipPath = `inset(0 0 0 ${this.slider.value}%)`;
  }

  // Fetches the view from the triangles once the viewer rests, and hides it while the viewer moves.
  async follow(now, moving, size) {
    const here = pose(), query = `frame?eye=${here.eye.map(rounded)}&target=${target(here)}&fov_deg=${here.fov}&size=${size.join("x")}&direct`;
    const wanted = this.box.checked && !moving;
    this.slider.hidden = !this.box.checked;
    this.image.hidden = !wanted || this.shows !== query;
    if (!wanted || this.shows === query || this.busy) return;
    this.busy = true;
    try {
      const answer = await fetch(ofScene(query));
      if (!answer.ok) throw new Error(await answer.text());
      URL.revokeObjectURL(this.image.src);
      this.image.src = URL.createObjectURL(await answer.blob());
      await this.image.decode();
      this.shows = query;
      this.place();
    } catch {
      // The service is busy or gone; the page says so where it asks for its own view.
      await new Promise(done => setTimeout(done, 1000));
    }
    this.busy = false;
  }
}
