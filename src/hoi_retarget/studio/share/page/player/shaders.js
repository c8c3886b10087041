// Shaders; `pane` is where a subject stands, and its scale.

const INSTANCE = `#version 300 es
layout(location = 0) in vec3 corner;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 axis_x;
layout(location = 3) in vec3 axis_y;
layout(location = 4) in vec3 axis_z;
layout(location = 5) in vec3 place;
layout(location = 6) in vec3 colour;
uniform mat4 view;
uniform vec4 pane;
vec3 world() { return pane.xyz + pane.w * (place + mat3(axis_x, axis_y, axis_z) * corner); }
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
  for (int i = -1; i <= 1; i++)
    for (int j = -1; j <= 1; j++)
      sum += texture(shadows, vec3(p.xy + vec2(i, j) * ${(1.8 / SHADOW_SIZE).toFixed(8)}, p.z));
  return sum / 9.0;
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
  if (direct > 0.0) direct *= lit(point + 0.02 * n);
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
