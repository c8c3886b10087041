"use strict";
// Plays a packed scene (packed_scene.py) with WebGL 2: nothing is loaded, everything is in the page. The files of
// this folder are one script, in the order of `html.assets`: numbers, meshes, shaders, shapes, picture, camera,
// timeline, player.
//
// Here: vectors, matrices column by column, and unpacked numbers.

const FIELD_OF_VIEW = Math.PI / 5;
const SHADOW_SIZE = 2048;
const BACKGROUND = [0.972, 0.976, 0.98];
const SUN = normalized([0.35, -0.45, 1]);

function normalized(a) {
  const length = Math.hypot(...a) || 1;
  return a.map((x) => x / length);
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function product(a, b) {
  const c = new Float32Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) c[4 * column + row] += a[4 * k + row] * b[4 * column + k];
  return c;
}

function lookAt(eye, target) {
  const back = normalized(eye.map((x, i) => x - target[i]));
  const right = normalized(cross([0, 0, 1], back));
  const up = cross(back, right);
  return new Float32Array([
    right[0], up[0], back[0], 0,
    right[1], up[1], back[1], 0,
    right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
  ]);
}

function perspective(aspect, near, far) {
  const f = 1 / Math.tan(FIELD_OF_VIEW / 2);
  const depth = near - far;
  return new Float32Array([
    f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / depth, -1, 0, 0, (2 * far * near) / depth, 0,
  ]);
}

function orthographic(half, near, far) {
  const depth = near - far;
  return new Float32Array([
    1 / half, 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, 2 / depth, 0, 0, 0, (far + near) / depth, 1,
  ]);
}

async function unpacked(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

class Track {
  // Numbers over time, column by column: second differences of 16 bits, low bytes before high ones.
  constructor(bytes, { at, frames, width, low, step }) {
    const count = frames * width;
    const whole = new Uint16Array(2); // Wraps around as the differences do: change and level.
    this.frames = frames;
    this.width = width;
    this.values = new Float32Array(count);
    for (let column = 0; column < width; column++) {
      whole.fill(0);
      for (let frame = 0; frame < frames; frame++) {
        const i = at + column * frames + frame;
        whole[0] += bytes[i] | (bytes[i + count] << 8);
        whole[1] += whole[0];
        this.values[frame * width + column] = low + step * whole[1];
      }
    }
    this.now = new Float32Array(width);
  }

  // Return the numbers at a frame that may lie between two.
  at(frame) {
    if (this.frames === 1) return this.values;
    const before = Math.min(Math.floor(frame), this.frames - 1);
    const share = frame - before;
    const first = before * this.width;
    const second = Math.min(before + 1, this.frames - 1) * this.width;
    for (let i = 0; i < this.width; i++)
      this.now[i] = this.values[first + i] * (1 - share) + this.values[second + i] * share;
    return this.now;
  }

  nearest(frame) {
    const first = this.frames === 1 ? 0 : Math.min(Math.round(frame), this.frames - 1) * this.width;
    return this.values.subarray(first, first + this.width);
  }
}
