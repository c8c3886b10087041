// The camera: it turns about what it follows, in all views alike.

class Camera {
  constructor(canvas, home, changed) {
    this.home = home;
    this.view = { name: "floor", width: canvas.clientWidth, height: canvas.clientHeight };
    this.canvas = canvas;
    this.changed = changed;
    this.pointers = new Map();
    this.reset();
    canvas.addEventListener("pointerdown", (event) => {
      this.turned = true;
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, event);
    });
    for (const name of ["pointerup", "pointercancel"])
      canvas.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => this.move(event, this.view.height));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.turned = true;
        this.zoom(Math.exp(0.0012 * event.deltaY * (event.deltaMode ? 30 : 1)));
      },
      { passive: false },
    );
  }

  // See everything in the views of an arrangement, from the home direction.
  reset() {
    const { azimuth, elevation } = this.home;
    const { shift, reaches } = this.home[this.view.name === "floor" ? "floor" : "each"];
    const aspect = this.view.width / this.view.height;
    const distances = reaches.map(
      ([sideways, upright, near]) => Math.max(upright, sideways / aspect) / Math.tan(FIELD_OF_VIEW / 2) + near,
    );
    Object.assign(this, { azimuth, elevation, shift: [...shift], distance: 1.03 * Math.max(...distances) });
    this.turned = false; // Until the user moves it.
    this.changed();
  }

  // Stand at an angle from the robots' front, and as high [rad].
  stand(from_front, elevation) {
    this.turned = true;
    Object.assign(this, { azimuth: this.home.front + from_front, elevation, shift: [0, 0, this.shift[2]] });
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
