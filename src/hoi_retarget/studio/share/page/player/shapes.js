// Every shape is an instance of a mesh; an instance is three columns (axes times half extents) and a place. They are
// computed for each drawn frame, between two recorded ones where playback is between them.

const LINE_RADIUS = 0.004;

class Instances {
  constructor(gl, corners, count) {
    this.gl = gl;
    this.count = count;
    this.corners = corners.length / 6;
    this.places = new Float32Array(12 * count);
    this.colours = new Float32Array(3 * count);
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    this.cornerBuffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.cornerBuffer);
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

  free() {
    for (const buffer of [this.cornerBuffer, this.placeBuffer, this.colourBuffer]) this.gl.deleteBuffer(buffer);
    this.gl.deleteVertexArray(this.array);
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
