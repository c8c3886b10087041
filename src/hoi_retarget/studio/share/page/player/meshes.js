// Meshes: position and normal of each corner.

function sphere() {
  const rows = 12, columns = 20, corners = [];
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

const CREASE = Math.cos((40 * Math.PI) / 180);
const GRID = 0x10000;

// A number for each place: vertices at one place, to a part in 65,536 of the mesh, are one.
function placesOf(vertices) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < vertices.length; i++) {
    low[i % 3] = Math.min(low[i % 3], vertices[i]);
    high[i % 3] = Math.max(high[i % 3], vertices[i]);
  }
  const step = Math.max(high[0] - low[0], high[1] - low[1], high[2] - low[2]) / (GRID - 1) || 1;
  const known = new Map(), places = new Uint32Array(vertices.length / 3);
  for (let v = 0, i = 0; v < places.length; v++, i += 3) {
    const [x, y, z] = [0, 1, 2].map((axis) => Math.round((vertices[i + axis] - low[axis]) / step));
    const key = (x * GRID + y) * GRID + z, found = known.get(key);
    places[v] = found === undefined ? known.size : found;
    if (found === undefined) known.set(key, known.size);
  }
  return places;
}

// Corners of triangles. Those that meet at a small angle are of one round surface: files of objects seldom tell which
// edges are round.
function solid(vertices, faces) {
  const count = faces.length, places = placesOf(vertices), across = new Float64Array(count), lengths = new Float64Array(count / 3);
  const corner = Uint32Array.from(faces, Math.round);
  // All corners at a place, in a chain.
  const first = new Int32Array(places.length).fill(-1), next = new Int32Array(count);
  for (let t = 0; t < count; t += 3) {
    const a = 3 * corner[t], b = 3 * corner[t + 1], c = 3 * corner[t + 2];
    const ux = vertices[b] - vertices[a], uy = vertices[b + 1] - vertices[a + 1], uz = vertices[b + 2] - vertices[a + 2];
    const vx = vertices[c] - vertices[a], vy = vertices[c + 1] - vertices[a + 1], vz = vertices[c + 2] - vertices[a + 2];
    across[t] = uy * vz - uz * vy;
    across[t + 1] = uz * vx - ux * vz;
    across[t + 2] = ux * vy - uy * vx;
    lengths[t / 3] = Math.hypot(across[t], across[t + 1], across[t + 2]);
    for (let k = t; k < t + 3; k++) {
      next[k] = first[places[corner[k]]];
      first[places[corner[k]]] = k;
    }
  }
  const corners = new Float32Array(6 * count);
  for (let k = 0; k < count; k++) {
    const own = k - (k % 3), from = 3 * corner[k];
    let x = 0, y = 0, z = 0;
    for (let other = first[places[corner[k]]]; other >= 0; other = next[other]) {
      const at = other - (other % 3);
      const along = across[own] * across[at] + across[own + 1] * across[at + 1] + across[own + 2] * across[at + 2];
      if (along <= CREASE * lengths[own / 3] * lengths[at / 3]) continue;
      x += across[at];
      y += across[at + 1];
      z += across[at + 2];
    }
    const length = Math.hypot(x, y, z) || 1;
    corners.set([vertices[from], vertices[from + 1], vertices[from + 2], x / length, y / length, z / length], 6 * k);
  }
  return corners;
}
