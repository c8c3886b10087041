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
