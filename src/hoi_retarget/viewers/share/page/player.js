"use strict";
// Plays a packed scene (packed_scene.py) with WebGL 2: nothing is loaded, everything is in the page.
//
// Every shape is an instance of a mesh; an instance is three columns (axes times half extents) and a
// place. They are computed for each drawn frame, between two recorded ones where playback is between them.

const FIELD_OF_VIEW = Math.PI / 5;
const LINE_RADIUS = 0.004;
const SHADOW_SIZE = 2048;
const BACKGROUND = [0.972, 0.976, 0.98];
const SUN = normalized([0.35, -0.45, 1]);

// ---------------------------------------------------------------- vectors and matrices, column by column

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

// ---------------------------------------------------------------- numbers

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

// ---------------------------------------------------------------- meshes: position and normal of each corner

function sphere() {
  const rows = 16, columns = 24, corners = [];
  const point = (i, j) => {
    const latitude = Math.PI * (i / rows - 0.5), longitude = (2 * Math.PI * j) / columns;
    const across = Math.cos(latitude);
    return [across * Math.cos(longitude), across * Math.sin(longitude), Math.sin(latitude)];
  };
  for (let i = 0; i < rows; i++)
    for (let j = 0; j < columns; j++) {
      const [a, b, c, d] = [point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j)];
      for (const p of [a, b, c, a, c, d]) corners.push(...p, ...p);
    }
  return corners;
}

function cylinder() {
  const columns = 32, corners = [];
  for (let j = 0; j < columns; j++) {
    const [a, b] = [j, j + 1].map((k) => (2 * Math.PI * k) / columns);
    const u = [Math.cos(a), Math.sin(a)], v = [Math.cos(b), Math.sin(b)];
    for (const [p, z] of [[u, -1], [v, -1], [v, 1], [u, -1], [v, 1], [u, 1]]) corners.push(...p, z, ...p, 0);
    for (const z of [-1, 1]) for (const p of [[0, 0], u, v]) corners.push(...p, z, 0, 0, z);
  }
  return corners;
}

function box() {
  const corners = [];
  for (let axis = 0; axis < 3; axis++)
    for (const side of [-1, 1])
      for (const [u, v] of [[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]]) {
        const p = [0, 0, 0], n = [0, 0, 0];
        p[axis] = n[axis] = side;
        p[(axis + 1) % 3] = u;
        p[(axis + 2) % 3] = v;
        corners.push(...p, ...n);
      }
  return corners;
}

function solid(vertices, faces) {
  // Every triangle has its own normal: files of objects seldom tell which edges are round.
  const corners = [];
  for (let i = 0; i < faces.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => {
      const at = 3 * Math.round(faces[i + k]);
      return [vertices[at], vertices[at + 1], vertices[at + 2]];
    });
    const n = normalized(cross(b.map((x, k) => x - a[k]), c.map((x, k) => x - a[k])));
    for (const p of [a, b, c]) corners.push(...p, ...n);
  }
  return corners;
}

// ---------------------------------------------------------------- shaders

const INSTANCE = `#version 300 es
layout(location = 0) in vec3 corner;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 axis_x;
layout(location = 3) in vec3 axis_y;
layout(location = 4) in vec3 axis_z;
layout(location = 5) in vec3 place;
layout(location = 6) in vec3 colour;
uniform mat4 view;
vec3 world() { return place + mat3(axis_x, axis_y, axis_z) * corner; }
`;

const LIGHT = `
precision highp float;
precision highp sampler2DShadow;
uniform mat4 sun_view;
uniform vec3 sun;
uniform sampler2DShadow shadows;
float lit(vec3 point) {
  vec3 p = (sun_view * vec4(point, 1.0)).xyz * 0.5 + 0.5;
  if (any(lessThan(p, vec3(0.0))) || any(greaterThan(p, vec3(1.0)))) return 1.0;
  float sum = 0.0;
  for (int i = -2; i <= 2; i++)
    for (int j = -2; j <= 2; j++)
      sum += texture(shadows, vec3(p.xy + vec2(i, j) * ${(1.2 / SHADOW_SIZE).toFixed(8)}, p.z));
  return sum / 25.0;
}
`;

const SURFACE_VERTEX = `${INSTANCE}
out vec3 point;
out vec3 across;
out vec3 paint;
void main() {
  point = world();
  // Normals turn with the axes and shrink where these grow.
  across = axis_x * normal.x / max(dot(axis_x, axis_x), 1e-12) + axis_y * normal.y / max(dot(axis_y, axis_y), 1e-12)
         + axis_z * normal.z / max(dot(axis_z, axis_z), 1e-12);
  paint = colour;
  gl_Position = view * vec4(point, 1.0);
}`;

const SURFACE_FRAGMENT = `#version 300 es
${LIGHT}
uniform vec3 eye;
uniform float opacity;
in vec3 point;
in vec3 across;
in vec3 paint;
out vec4 result;
void main() {
  vec3 n = normalize(across), look = normalize(eye - point);
  if (dot(n, look) < 0.0) n = -n;
  float direct = max(dot(n, sun), 0.0);
  if (direct > 0.0) direct *= lit(point + 0.012 * n);
  float gleam = pow(max(dot(n, normalize(sun + look)), 0.0), 40.0) * direct;
  vec3 ambient = mix(vec3(0.34, 0.33, 0.32), vec3(0.58, 0.6, 0.63), 0.5 + 0.5 * n.z);
  float fill = 0.16 * max(dot(n, look), 0.0);
  vec3 light = pow(paint, vec3(2.2)) * (ambient + fill + 0.72 * direct) + 0.07 * gleam;
  result = vec4(pow(min(light, 1.0), vec3(1.0 / 2.2)), opacity);
}`;

const DEPTH_VERTEX = `${INSTANCE}
void main() { gl_Position = view * vec4(world(), 1.0); }`;

const DEPTH_FRAGMENT = `#version 300 es
precision highp float;
void main() {}`;

const FLOOR_VERTEX = `#version 300 es
uniform mat4 view;
uniform vec2 middle;
uniform float extent;
out vec3 point;
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  point = vec3(middle + extent * corner, 0.0);
  gl_Position = view * vec4(point, 1.0);
}`;

const FLOOR_FRAGMENT = `#version 300 es
${LIGHT}
uniform vec2 middle;
uniform float extent;
uniform vec3 background;
in vec3 point;
out vec4 result;
float lines(float spacing, float width) {
  vec2 away = abs(fract(point.xy / spacing - 0.5) - 0.5) * spacing;
  vec2 pixel = fwidth(point.xy);
  vec2 line = 1.0 - smoothstep(vec2(width), vec2(width) + 1.5 * pixel, away);
  return max(line.x, line.y) * clamp(width * 8.0 / max(pixel.x, pixel.y), 0.0, 1.0);
}
void main() {
  vec3 colour = vec3(0.915, 0.922, 0.93);
  colour = mix(colour, vec3(0.83, 0.845, 0.86), 0.9 * lines(1.0, 0.004));
  colour *= mix(0.72, 1.0, lit(point));
  float fade = smoothstep(0.35, 1.0, length(point.xy - middle) / extent);
  result = vec4(mix(colour, background, fade), 1.0);
}`;

function compiled(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  const uniforms = {};
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(program, i);
    uniforms[name] = gl.getUniformLocation(program, name);
  }
  return { program, uniforms };
}

// ---------------------------------------------------------------- what is drawn

class Instances {
  constructor(gl, corners, count) {
    this.gl = gl;
    this.count = count;
    this.corners = corners.length / 6;
    this.places = new Float32Array(12 * count);
    this.colours = new Float32Array(3 * count);
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.STATIC_DRAW);
    this.attribute(0, 24, 0);
    this.attribute(1, 24, 12);
    this.placeBuffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.placeBuffer);
    for (let column = 0; column < 4; column++) {
      this.attribute(2 + column, 48, 12 * column);
      gl.vertexAttribDivisor(2 + column, 1);
    }
    this.colourBuffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.colourBuffer);
    this.attribute(6, 12, 0);
    gl.vertexAttribDivisor(6, 1);
  }

  attribute(location, stride, offset) {
    this.gl.enableVertexAttribArray(location);
    this.gl.vertexAttribPointer(location, 3, this.gl.FLOAT, false, stride, offset);
  }

  send() {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.placeBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, this.places, gl.DYNAMIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.colourBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, this.colours, gl.DYNAMIC_DRAW);
  }

  draw() {
    this.gl.bindVertexArray(this.array);
    this.gl.drawArraysInstanced(this.gl.TRIANGLES, 0, this.corners, this.count);
  }
}

class Part {
  constructor(gl, bytes, part) {
    const track = (name) => (part[name] ? new Track(bytes, part[name]) : null);
    for (const name of ["sizes", "colours", "positions", "quats", "starts", "ends", "visible"]) this[name] = track(name);
    const meshes = { sphere, cylinder, box, lines: cylinder };
    const corners = part.kind === "solid" ? solid(track("vertices").values, track("faces").values) : meshes[part.kind]();
    this.instances = new Instances(gl, corners, part.count);
  }

  show(frame) {
    const { places, colours, count } = this.instances;
    const present = this.visible && this.visible.nearest(frame);
    if (this.starts) this.stretch(frame, places, count);
    else this.turn(frame, places, count);
    if (present) for (let k = 0; k < count; k++) if (present[k] < 0.5) places.fill(0, 12 * k, 12 * k + 12);
    const paint = this.colours.nearest(frame);
    for (let i = 0; i < 3 * count; i++) colours[i] = paint[i] / 255;
    this.instances.send();
  }

  turn(frame, places, count) {
    const p = this.positions.at(frame), q = this.quats.at(frame), s = this.sizes.values;
    for (let k = 0; k < count; k++) {
      let [w, x, y, z] = q.subarray(4 * k, 4 * k + 4);
      const length = Math.sqrt(w * w + x * x + y * y + z * z) || 1;
      (w /= length), (x /= length), (y /= length), (z /= length);
      const [a, b, c] = s.subarray(3 * k, 3 * k + 3);
      const at = 12 * k;
      places[at] = a * (1 - 2 * (y * y + z * z));
      places[at + 1] = a * 2 * (x * y + w * z);
      places[at + 2] = a * 2 * (x * z - w * y);
      places[at + 3] = b * 2 * (x * y - w * z);
      places[at + 4] = b * (1 - 2 * (x * x + z * z));
      places[at + 5] = b * 2 * (y * z + w * x);
      places[at + 6] = c * 2 * (x * z + w * y);
      places[at + 7] = c * 2 * (y * z - w * x);
      places[at + 8] = c * (1 - 2 * (x * x + y * y));
      places.set(p.subarray(3 * k, 3 * k + 3), at + 9);
    }
  }

  stretch(frame, places, count) {
    const starts = this.starts.at(frame), ends = this.ends.at(frame);
    for (let k = 0; k < count; k++) {
      const a = [...starts.subarray(3 * k, 3 * k + 3)], b = [...ends.subarray(3 * k, 3 * k + 3)];
      const half = b.map((x, i) => (x - a[i]) / 2);
      const along = normalized(half);
      const u = normalized(cross(along, Math.abs(along[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
      const v = cross(along, u);
      const columns = [u.map((x) => LINE_RADIUS * x), v.map((x) => LINE_RADIUS * x), half, a.map((x, i) => x + half[i])];
      columns.forEach((column, i) => places.set(column, 12 * k + 3 * i));
    }
  }
}

class Picture {
  constructor(canvas, description, bytes) {
    const gl = canvas.getContext("webgl2", { antialias: true });
    if (!gl) throw new Error("This browser cannot draw in 3D (WebGL 2 is off).");
    this.gl = gl;
    this.canvas = canvas;
    this.surface = compiled(gl, SURFACE_VERTEX, SURFACE_FRAGMENT);
    this.depth = compiled(gl, DEPTH_VERTEX, DEPTH_FRAGMENT);
    this.floor = compiled(gl, FLOOR_VERTEX, FLOOR_FRAGMENT);
    this.nothing = gl.createVertexArray();
    this.subjects = description.subjects.map((subject) => ({
      fps: subject.fps,
      centre: new Track(bytes, subject.centre),
      looks: new Map(Object.entries(subject.looks).map(([name, path]) => [name, new Track(bytes, path)])),
      layers: subject.layers.map((layer) => ({ ...layer, solid: layer.opacity, parts: layer.parts.map((part) => new Part(gl, bytes, part)) })),
    }));
    this.reach = Math.max(...description.camera.reaches.flat());
    this.makeShadows();
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE);
  }

  makeShadows() {
    const gl = this.gl;
    this.shadows = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.shadows);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_SIZE, SHADOW_SIZE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    this.shadowFrame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadows, 0);
  }

  centre(second) {
    const middle = [0, 0, 0];
    for (const subject of this.subjects) {
      const at = subject.centre.at(second * subject.fps);
      for (let i = 0; i < 3; i++) middle[i] += at[i] / this.subjects.length;
    }
    return middle;
  }

  // Return where what is looked at from near is, by its name.
  look(name, second) {
    const subject = this.subjects.find((item) => item.looks.has(name));
    return [...subject.looks.get(name).at(second * subject.fps)];
  }

  seeThrough(on) {
    for (const subject of this.subjects)
      for (const layer of subject.layers) layer.opacity = on && layer.through ? layer.through : layer.solid;
  }

  show(second) {
    for (const subject of this.subjects)
      for (const layer of subject.layers)
        if (layer.shown) for (const part of layer.parts) part.show(second * subject.fps);
  }

  draw(eye, target, middle) {
    const gl = this.gl;
    const layers = this.subjects.flatMap((subject) => subject.layers).filter((layer) => layer.shown);
    const opaque = layers.filter((layer) => layer.opacity >= 1), ghosts = layers.filter((layer) => layer.opacity < 1);
    const half = this.reach + 1.5;
    const above = middle.map((x, i) => x + 3 * half * SUN[i]);
    const sunView = product(orthographic(half, half, 6 * half), lookAt(above, middle));

    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.viewport(0, 0, SHADOW_SIZE, SHADOW_SIZE);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 4);
    this.drawDepth(opaque, sunView);
    gl.disable(gl.POLYGON_OFFSET_FILL);

    const { width, height } = this.canvas;
    const away = Math.hypot(...eye.map((x, i) => x - target[i]));
    const view = product(perspective(width / height, 0.02 * away, 20 * away + 60), lookAt(eye, target));
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...BACKGROUND, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);

    const light = ({ program, uniforms }) => {
      gl.useProgram(program);
      gl.uniformMatrix4fv(uniforms.view, false, view);
      gl.uniformMatrix4fv(uniforms.sun_view, false, sunView);
      gl.uniform1i(uniforms.shadows, 0);
      return uniforms;
    };
    const ground = light(this.floor);
    gl.uniform2f(ground.middle, target[0], target[1]);
    gl.uniform1f(ground.extent, 6 + 2.5 * away);
    gl.uniform3f(ground.background, ...BACKGROUND);
    gl.bindVertexArray(this.nothing);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);

    const surfaces = (group, opacity) => {
      const uniforms = light(this.surface);
      gl.uniform3f(uniforms.sun, ...SUN);
      gl.uniform3f(uniforms.eye, ...eye);
      gl.uniform1f(uniforms.opacity, opacity);
      for (const layer of group) for (const part of layer.parts) part.instances.draw();
    };
    surfaces(opaque, 1);
    for (const layer of ghosts) {
      // Only what is nearest of a ghost is seen, not what is inside of it.
      gl.colorMask(false, false, false, false);
      this.drawDepth([layer], view);
      gl.colorMask(true, true, true, true);
      gl.enable(gl.BLEND);
      surfaces([layer], layer.opacity);
      gl.disable(gl.BLEND);
    }
  }

  drawDepth(layers, view) {
    const gl = this.gl;
    gl.useProgram(this.depth.program);
    gl.uniformMatrix4fv(this.depth.uniforms.view, false, view);
    for (const layer of layers) for (const part of layer.parts) part.instances.draw();
  }
}

// ---------------------------------------------------------------- camera

class Camera {
  constructor(canvas, home, changed) {
    this.home = home;
    this.canvas = canvas;
    this.changed = changed;
    this.pointers = new Map();
    this.reset();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, event);
    });
    for (const name of ["pointerup", "pointercancel"])
      canvas.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => this.move(event, canvas.clientHeight));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.zoom(Math.exp(0.0012 * event.deltaY * (event.deltaMode ? 30 : 1)));
      },
      { passive: false },
    );
  }

  reset() {
    const { azimuth, elevation, shift, reaches } = this.home;
    const aspect = this.canvas.clientWidth / this.canvas.clientHeight;
    const distances = reaches.map(
      ([sideways, upright, near]) => Math.max(upright, sideways / aspect) / Math.tan(FIELD_OF_VIEW / 2) + near,
    );
    Object.assign(this, { azimuth, elevation, shift: [...shift], distance: 1.03 * Math.max(...distances) });
    this.changed();
  }

  approach(reach) {
    Object.assign(this, { shift: [0, 0, 0], distance: reach / Math.tan(FIELD_OF_VIEW / 2) });
    this.changed();
  }

  zoom(factor) {
    this.distance = Math.min(Math.max(this.distance * factor, 0.15), 60);
    this.changed();
  }

  move(event, height) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
    const others = [...this.pointers.values()].filter((pointer) => pointer.pointerId !== event.pointerId);
    this.pointers.set(event.pointerId, event);
    if (others.length) {
      const away = (pointer) => Math.hypot(pointer.clientX - others[0].clientX, pointer.clientY - others[0].clientY);
      this.pan(dx / 2, dy / 2, height);
      this.zoom(away(before) / Math.max(away(event), 1));
    } else if (event.buttons & 6 || event.shiftKey) {
      this.pan(dx, dy, height);
    } else {
      this.azimuth -= 0.008 * dx;
      this.elevation = Math.min(Math.max(this.elevation + 0.008 * dy, -0.1), 1.55);
    }
    this.changed();
  }

  pan(dx, dy, height) {
    const metres = (2 * this.distance * Math.tan(FIELD_OF_VIEW / 2)) / height;
    const right = [-Math.sin(this.azimuth), Math.cos(this.azimuth), 0];
    const up = cross(this.direction(), right);
    for (let i = 0; i < 3; i++) this.shift[i] += metres * (dy * up[i] - dx * right[i]);
  }

  direction() {
    const flat = Math.cos(this.elevation);
    return [flat * Math.cos(this.azimuth), flat * Math.sin(this.azimuth), Math.sin(this.elevation)];
  }

  // Return eye and target of a camera around a place.
  around(place) {
    const target = place.map((x, i) => x + this.shift[i]);
    return [this.direction().map((x, i) => target[i] + this.distance * x), target];
  }
}

// ---------------------------------------------------------------- the page

async function start(description) {
  const element = (id) => document.getElementById(id);
  const canvas = element("picture"), slider = element("time"), button = element("play"), speed = element("speed");
  const follow = element("follow"), look = element("look"), through = element("through"), clock = element("clock"), cursor = element("cursor"), curves = element("curves");
  const { fps, seconds } = description;
  const picture = new Picture(canvas, description, await unpacked(description.numbers));
  const insets = curves ? [Number(curves.dataset.left), Number(curves.dataset.right)] : [0, 0];
  let second = 0, playing = true, before = null, stale = true;
  const camera = new Camera(canvas, description.camera, () => (stale = true));
  const first = picture.centre(0);

  const seek = (value) => {
    second = Math.min(Math.max(value, 0), seconds);
    stale = true;
  };
  const play = (on) => {
    if (on && second >= seconds) seek(0);
    playing = on;
    before = null;
    button.textContent = on ? "\u275A\u275A" : "\u25B6";
    button.setAttribute("aria-label", on ? "Pause" : "Play");
  };

  const draw = (now) => {
    if (playing && before !== null) {
      const next = second + (Number(speed.value) * (now - before)) / 1000;
      seek(next > seconds ? 0 : next);
    }
    before = now;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) {
      [canvas.width, canvas.height] = [width, height];
      stale = true;
    }
    if (stale && width && height) {
      stale = false;
      const middle = picture.centre(second);
      picture.show(second);
      const place = look.value ? picture.look(look.value, second) : follow.checked ? middle : first;
      picture.draw(...camera.around(place), middle);
      const frame = Math.round(second * fps);
      slider.value = frame;
      clock.textContent = `${second.toFixed(2)} s \u00b7 frame ${frame}`;
      if (cursor) cursor.style.left = `calc(${insets[0]}px + (100% - ${insets[0] + insets[1]}px) * ${second / seconds})`;
    }
    requestAnimationFrame(draw);
  };

  slider.max = Math.round(seconds * fps);
  slider.addEventListener("input", () => {
    play(false);
    seek(slider.value / fps);
  });
  button.addEventListener("click", () => play(!playing));
  follow.addEventListener("change", () => (stale = true));
  const lookAt = (index) => {
    if (index >= look.options.length) return;
    look.selectedIndex = index;
    if (look.value) camera.approach(description.close);
    else camera.reset();
  };
  for (const name of new Set(picture.subjects.flatMap((subject) => [...subject.looks.keys()])))
    look.append(new Option(name, name));
  look.addEventListener("change", () => lookAt(look.selectedIndex));
  through.addEventListener("change", () => {
    picture.seeThrough(through.checked);
    stale = true;
  });
  canvas.addEventListener("dblclick", () => lookAt(0));
  element("home").addEventListener("click", () => lookAt(0));
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("input, select, button, a") || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === " ") play(!playing);
    else if (event.key === "x") through.click();
    else if (event.key >= "1" && event.key <= "9") lookAt(Number(event.key) - 1);
    else if (step) {
      play(false);
      seek((Math.round(second * fps) + step) / fps);
    } else return;
    event.preventDefault();
  });
  if (curves) {
    const point = (event) => {
      const { left, width } = curves.getBoundingClientRect();
      play(false);
      seek((seconds * (event.clientX - left - insets[0])) / (width - insets[0] - insets[1]));
    };
    curves.addEventListener("pointerdown", (event) => {
      curves.setPointerCapture(event.pointerId);
      point(event);
    });
    curves.addEventListener("pointermove", (event) => event.buttons & 1 && point(event));
  }
  for (const subject of picture.subjects)
    for (const layer of subject.layers) {
      if (!layer.parts.length) continue;
      const label = document.createElement("label"), input = document.createElement("input");
      input.type = "checkbox";
      input.checked = layer.shown;
      input.addEventListener("change", () => {
        layer.shown = input.checked;
        stale = true;
      });
      label.append(input, layer.name);
      element("layers").append(label);
    }
  play(true);
  requestAnimationFrame(draw);
}

start(JSON.parse(document.getElementById("scene").textContent)).catch((error) => {
  const note = document.getElementById("trouble");
  note.textContent = `The scene cannot be shown here. ${error.message || error} A current browser is needed.`;
  note.hidden = false;
});
