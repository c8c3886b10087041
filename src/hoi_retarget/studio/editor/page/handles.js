// Handles over the picture: a point for each contact, and the axes and rings by which one of them, or a pinned part, is
// moved and turned. Quaternions are [w, x, y, z].

const AXES = ["#d2403a", "#2a9549", "#2f6fd0"];
const ARM_PX = 95, RING = 0.68; // Length of an arrow on the picture, and radius of a ring as a share of it.
const RING_STEPS = 48;

const turns = {
  times: ([a, b, c, d], [w, x, y, z]) => [
    a * w - b * x - c * y - d * z,
    a * x + b * w + c * z - d * y,
    a * y - b * z + c * w + d * x,
    a * z + b * y - c * x + d * w,
  ],
  back: ([w, x, y, z]) => [w, -x, -y, -z],
  apply: (q, v) => turns.times(turns.times(q, [0, ...v]), turns.back(q)).slice(1),
  // A rotation vector [rad] as a quaternion, and the other way.
  of: (vector) => {
    const angle = Math.hypot(...vector);
    const share = angle < 1e-9 ? 0.5 : Math.sin(angle / 2) / angle;
    return [Math.cos(angle / 2), ...vector.map((x) => share * x)];
  },
  vector: (q) => {
    const [w, ...axis] = q[0] < 0 ? q.map((x) => -x) : q;
    const sine = Math.hypot(...axis);
    return axis.map((x) => (sine < 1e-9 ? 2 * x : (2 * Math.atan2(sine, w) * x) / sine));
  },
};

const axis = (index, length) => [0, 1, 2].map((i) => (i === index ? length : 0));

const ringAngles = Array.from({ length: RING_STEPS + 1 }, (_, k) => (2 * Math.PI * k) / RING_STEPS);

// Return a point of the ring about an axis of a handle; `size` is the length of its arrows [m].
function onRing(place, quat, index, angle, size) {
  const [a, b] = [RING * size * Math.cos(angle), RING * size * Math.sin(angle)];
  const offset = axis((index + 1) % 3, a).map((x, i) => x + axis((index + 2) % 3, b)[i]);
  return turns.apply(quat, offset).map((x, i) => place[i] + x);
}

class Handles {
  // `pull` receives a target, its new place in the world, its new rotation, and whether it was let go.
  constructor(stage, player, { choose, pull, grab }) {
    this.player = player;
    this.choose = choose;
    this.pull = pull;
    this.grab = grab;
    this.svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    this.svg.id = "handles";
    stage.append(this.svg);
    this.points = [];
    this.target = null;
    this.moved = null;
    player.onDraw.push((view, seen) => this.draw(view, seen));
  }

  element(name, attributes) {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    this.svg.append(made);
    return made;
  }

  // Show points ({ number, place(frame), colour }), and the handle of a target ({ place(frame), quat(frame), turns }).
  show(points, target) {
    Object.assign(this, { points, target });
    this.svg.replaceChildren();
    this.balls = points.map((point) => {
      const ball = this.element("circle", { r: 7, class: "ball", fill: point.colour, "data-contact": point.number });
      ball.append(document.createElementNS("http://www.w3.org/2000/svg", "title"));
      ball.firstChild.textContent = point.name;
      ball.addEventListener("click", () => this.choose(point.number));
      return ball;
    });
    this.parts = [];
    if (target) {
      const part = (kind, index, name) => {
        const colour = index === null ? "#ff8c00" : AXES[index];
        const seen = this.element(name, { class: `handle ${kind}`, stroke: colour, fill: index === null ? colour : "none" });
        const taken = this.element(name, { class: "grip", "data-grip": index === null ? kind : `${kind}-${"xyz"[index]}` });
        this.parts.push({ kind, index, elements: [seen, taken] });
        this.listen(taken, kind, index);
      };
      for (const index of target.turns ? [0, 1, 2] : []) part("ring", index, "polyline");
      for (const index of [0, 1, 2]) part("arrow", index, "line");
      part("middle", null, "circle");
    }
    this.player.draw();
  }

  frame() {
    return Math.round(this.player.at() * this.player.fps);
  }

  // Place everything over a view that was drawn with a matrix.
  draw(view, seen) {
    const figure = view.figures.find(({ subject }) => !subject.human);
    if (!figure) return;
    const ratio = this.player.picture.canvas.width / this.player.picture.canvas.clientWidth;
    this.project = (at) => {
      const p = at.map((x, i) => figure.scale * x + figure.shift[i]);
      const [x, y, , w] = [0, 1, 2, 3].map((row) => seen[row] * p[0] + seen[4 + row] * p[1] + seen[8 + row] * p[2] + seen[12 + row]);
      if (w <= 0.01) return null;
      return [(view.x + (0.5 + (0.5 * x) / w) * view.width) / ratio, (view.y + (0.5 - (0.5 * y) / w) * view.height) / ratio];
    };
    const set = (element, values) => {
      for (const [key, value] of Object.entries(values)) element.setAttribute(key, value);
    };
    const frame = this.frame();
    this.points.forEach((point, index) => {
      const at = this.project(point.place(frame));
      set(this.balls[index], at ? { cx: at[0], cy: at[1], display: "inline" } : { display: "none" });
    });
    if (!this.target) return;
    const place = this.moved ? this.moved.place : this.target.place(frame);
    const quat = this.moved ? this.moved.quat : this.target.quat(frame);
    const middle = this.project(place);
    this.size = middle ? ARM_PX / Math.hypot(...this.step(place, this.screen()[0])) : 1;
    for (const { kind, index, elements } of this.parts)
      for (const element of elements) {
        const reach = (offset) => this.project(place.map((x, i) => x + turns.apply(quat, offset)[i]));
        element.setAttribute("display", middle ? "inline" : "none");
        if (!middle) continue;
        if (kind === "middle") set(element, { cx: middle[0], cy: middle[1], r: element.classList.contains("grip") ? 13 : 7 });
        else if (kind === "arrow") {
          const tip = reach(axis(index, this.size)) || middle;
          set(element, { x1: middle[0], y1: middle[1], x2: tip[0], y2: tip[1] });
        } else {
          const corners = ringAngles.map((angle) => this.project(onRing(place, quat, index, angle, this.size)));
          if (corners.every(Boolean)) set(element, { points: corners.map((corner) => corner.join()).join(" ") });
        }
      }
  }

  // The directions to the right and upwards on the picture.
  screen() {
    const back = this.player.camera.direction(), right = normalized(cross([0, 0, 1], back));
    return [right, cross(back, right)];
  }

  // Return where a step from a place along a direction goes on the picture [px/m].
  step(place, way) {
    const [from, to] = [0, 0.02].map((length) => this.project(place.map((x, i) => x + length * way[i])));
    return to.map((x, i) => (x - from[i]) / 0.02);
  }

  listen(element, kind, index) {
    let start = null;
    const here = (event) => {
      const box = this.svg.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    element.addEventListener("pointerdown", (event) => {
      event.stopPropagation();
      element.setPointerCapture(event.pointerId);
      this.grab();
      this.player.hold(true);
      const frame = this.frame();
      start = { frame, pointer: here(event), place: this.target.place(frame), quat: this.target.quat(frame), pulled: false };
    });
    element.addEventListener("pointermove", (event) => {
      if (!start) return;
      start.pulled = true;
      this.moved = this.pulled(kind, index, start, here(event));
      this.pull(this.target, start.frame, this.moved, false);
      this.player.draw();
    });
    const end = async (event) => {
      if (!start) return;
      const { frame, pulled } = start;
      start = null;
      if (pulled) await this.pull(this.target, frame, this.moved, event.type === "pointerup");
      this.moved = null;
      this.player.hold(false);
      this.player.draw();
    };
    for (const name of ["pointerup", "pointercancel"]) element.addEventListener(name, end);
  }

  // Return the place and rotation to which a pointer takes a handle.
  pulled(kind, index, { pointer, place, quat }, now) {
    const dx = now[0] - pointer[0], dy = now[1] - pointer[1];
    const along = (way, metres) => place.map((x, i) => x + metres * way[i]);
    if (kind === "arrow") {
      const way = turns.apply(quat, axis(index, 1)), [x, y] = this.step(place, way);
      return { place: along(way, (dx * x + dy * y) / Math.max(x * x + y * y, 100)), quat, turned: false };
    }
    if (kind === "middle") {
      const [right, up] = this.screen();
      const sideways = dx / Math.hypot(...this.step(place, right)), upwards = -dy / Math.hypot(...this.step(place, up));
      return { place: place.map((x, i) => x + sideways * right[i] + upwards * up[i]), quat, turned: false };
    }
    // Along the ring where it was taken, as far as that part of it moves for each radian.
    const at = (angle) => this.project(onRing(place, quat, index, angle, this.size));
    const away = (angle) => Math.hypot(...at(angle).map((x, i) => x - pointer[i]));
    const taken = ringAngles.reduce((best, angle) => (away(angle) < away(best) ? angle : best), 0);
    const [x, y] = at(taken + 0.05).map((x, i) => (x - at(taken - 0.05)[i]) / 0.1);
    const turn = (dx * x + dy * y) / Math.max(x * x + y * y, 100);
    return { place, quat: turns.times(quat, turns.of(axis(index, turn))), turned: true };
  }
}
