// Redraws frames from the viewer's camera, by WebGL2.
//
// A frame's pixel (x, y) of inverse depth i looks along d = (x', y', 1) in its camera's axes, and shows the point eye + d/i.
// Seen from another eye, and multiplied by i, that is d + i (eye − eye'). So clip coordinates are linear in (x', y', 1, i),
// i is affine over a leaf, and a leaf of any depth, the sky included, is one quad whose texture is interpolated exactly.

import { BLOCK } from "./relief.js";
import { axes } from "./viewer.js";

// Metres: what is nearer to the eye is not drawn.
const NEAR = 0.02;

const VERTEX = `#version 300 es
uniform mat4 clip_from_source;
uniform vec2 size, tangent;
in vec3 point;
out vec2 texel;
void main() {
  texel = point.xy / size;
  gl_Position = clip_from_source * vec4((2.0 * texel.x - 1.0) * tangent.x, (1.0 - 2.0 * texel.y) * tangent.y, 1.0, point.z);
}`;

const FRAGMENT = `#version 300 es
precision mediump float;
uniform sampler2D image;
in highp vec2 texel;
out vec4 color;
void main() { color = texture(image, texel); }`;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// Tangents of half the field of view of a camera, of a width and a height.
export const tangents = ({ fov }, width, height) => {
  const y = Math.tan(fov * Math.PI / 360);
  return [y * width / height, y];
};

// Column-major: clip coordinates of a viewer from (x', y', 1, inverse depth) of a frame's camera.
export function clipFromSource(source, viewer, [tx, ty]) {
  const from = axes(source), to = axes(viewer), apart = source.eye.map((x, i) => x - viewer.eye[i]);
  const column = direction => {
    const ahead = dot(to[2], direction);
    // Just before the far plane, so that rounding does not cut off the sky.
    return [dot(to[0], direction) / tx, dot(to[1], direction) / ty, ahead * (1 - 1e-6), ahead];
  };
  const moved = column(apart);
  moved[2] -= 2 * NEAR;
  return [...column(from[0]), ...column(from[1]), ...column(from[2]), ...moved];
}

export class Warp {
  // `null` if the browser has no WebGL2.
  static on(canvas) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, stencil: true, depth: true, powerPreference: "high-performance" });
    return gl && new Warp(gl);
  }

  constructor(gl) {
    this.gl = gl;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "point");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "the context is lost");
    gl.useProgram(program);
    for (const name of ["clip_from_source", "size", "tangent"]) this[name] = gl.getUniformLocation(program, name);
    gl.enableVertexAttribArray(0);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.STENCIL_TEST);
    gl.depthFunc(gl.LEQUAL);
    this.quads = this.indices(0, () => []);
    // The two frames' memory, the newest first.
    this.frames = [];
    this.free = [0, 1].map(() => this.memory());
  }

  memory() {
    const gl = this.gl, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.LINEAR);
    return { texture, leaves: gl.createBuffer(), sheet: gl.createBuffer(), grid: this.indices(0, () => []) };
  }

  // A buffer of the two triangles of each of `count` quads, from their corners.
  indices(count, corners) {
    const gl = this.gl, buffer = gl.createBuffer(), indices = new Uint32Array(6 * count);
    for (let i = 0; i < count; i++) {
      const [a, b, c, d] = corners(i);
      indices.set([a, b, c, c, b, d], 6 * i);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    return { buffer, count };
  }

  // Takes a frame: its image, size in pixels, pose, and relief. It replaces the older of two.
  take({ image, pose, points, ...about }) {
    const gl = this.gl, memory = this.free.pop() ?? this.frames.pop(), { width, height } = image;
    gl.bindTexture(gl.TEXTURE_2D, memory.texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, image);
    for (const [buffer, vertices] of [[memory.leaves, points.corners], [memory.sheet, points.backdrop]]) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STREAM_DRAW);
    }
    const leaves = points.corners.length / 12, columns = Math.ceil(width / BLOCK) + 1, rows = Math.ceil(height / BLOCK) + 1;
    if (leaves > this.quads.count) {
      gl.deleteBuffer(this.quads.buffer);
      this.quads = this.indices(2 * leaves, i => [4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3]);
    }
    if (memory.width !== width || memory.height !== height) {
      gl.deleteBuffer(memory.grid.buffer);
      memory.grid = this.indices(columns * rows, i => {
        const first = i + Math.floor(i / columns);
        return [first, first + 1, first + columns + 1, first + columns + 2];
      });
    }
    this.frames.unshift(Object.assign(memory, about, { pose, width, height, count: leaves, middle: points.middle, tangent: tangents(pose, width, height) }));
    return this.frames[0];
  }

  // Draws the frames from a pose, the first one before the others; what none shows is filled from around.
  draw(pose, frames) {
    const gl = this.gl, { width, height } = gl.canvas;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 1);
    gl.clearStencil(0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    const tangent = tangents(pose, width, height);
    frames.forEach((frame, i) => {
      if (i) gl.clear(gl.DEPTH_BUFFER_BIT);
      // A frame is seen where no earlier one is: their bits are 0.
      const earlier = (1 << i) - 1, bit = 1 << i;
      gl.stencilFunc(gl.EQUAL, bit, earlier);
      gl.stencilMask(bit);
      gl.stencilOp(gl.KEEP, gl.KEEP, gl.REPLACE);
      this.mesh(frame, pose, tangent, frame.leaves, this.quads.buffer, frame.count);
    });
    if (!frames.length) return;
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.stencilFunc(gl.EQUAL, 0, (1 << frames.length) - 1);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.KEEP);
    this.mesh(frames[0], pose, tangent, frames[0].sheet, frames[0].grid.buffer, frames[0].grid.count);
    gl.stencilMask(0xff);
  }

  mesh(frame, pose, tangent, points, indices, quads) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, frame.texture);
    gl.bindBuffer(gl.ARRAY_BUFFER, points);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indices);
    gl.uniformMatrix4fv(this.clip_from_source, false, clipFromSource(frame.pose, pose, tangent));
    gl.uniform2f(this.size, frame.width, frame.height);
    gl.uniform2f(this.tangent, ...frame.tangent);
    gl.drawElements(gl.TRIANGLES, 6 * quads, gl.UNSIGNED_INT, 0);
  }
}
