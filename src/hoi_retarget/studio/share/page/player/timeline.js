// The timeline (curve_chart.py) under the pointer: it is zoomed, read and dragged over, and says where to jump.

const SMALLEST_SPAN = 0.25; // [s]
const TICKS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300];

// The values of one curve, read from how it is drawn.
class CurveValues {
  constructor(path, output, chart, root) {
    const [high, low] = [...chart.querySelectorAll(".range span")].map((span) => Number(span.textContent));
    const width = Number(root.dataset.width), height = Number(root.dataset.height), seconds = Number(root.dataset.seconds);
    this.output = output;
    this.strokes = path
      .getAttribute("d")
      .split("M")
      .slice(1)
      .map((stroke) => {
        const numbers = stroke.replace("h0", "").split(/[ L]/).map(Number);
        const points = [];
        for (let i = 0; i < numbers.length; i += 2)
          points.push([(seconds * numbers[i]) / width, high - ((high - low) * numbers[i + 1]) / height]);
        return points;
      });
  }

  at(second, frame) {
    const stroke = this.strokes.find((points) => points[0][0] <= second + frame && points.at(-1)[0] >= second - frame);
    if (!stroke) return null;
    const after = stroke.findIndex(([at]) => at >= second);
    if (after <= 0) return stroke[after === 0 ? 0 : stroke.length - 1][1];
    const [[t0, v0], [t1, v1]] = [stroke[after - 1], stroke[after]];
    return v0 + ((v1 - v0) * (second - t0)) / (t1 - t0);
  }
}

class Timeline {
  constructor(box, { seconds, fps, seek, loop }) {
    Object.assign(this, { box, seconds, fps, seek, from: 0, span: 1, second: 0, range: null });
    this.cursor = box.querySelector("#cursor");
    this.pointer = document.createElement("div");
    this.pointer.id = "pointer";
    this.pointer.hidden = true;
    this.pointer.append(document.createElement("span"));
    box.append(this.pointer);
    this.note = document.getElementById("note");
    this.rangeMark = box.querySelector("#range");
    this.setLoop = loop;
    this.adopt();
    this.listen();
  }

  // Read the curves and bars that the page holds.
  adopt() {
    const box = this.box;
    this.root = box.querySelector(".curves");
    this.axis = box.querySelector(".time");
    this.values = [];
    for (const chart of box.querySelectorAll(".chart"))
      for (const path of chart.querySelectorAll("path[data-name]")) {
        const output = [...chart.querySelectorAll("b[data-of]")].find((b) => b.dataset.of === path.dataset.name);
        if (output) this.values.push(new CurveValues(path, output, chart, this.root));
      }
    this.bars = [...box.querySelectorAll(".bars i")].map((bar) => ({
      kind: bar.classList[0],
      start: this.seconds * Number(bar.style.getPropertyValue("--at")),
    }));
    for (const button of box.querySelectorAll(".worst"))
      button.addEventListener("click", () => this.seek(Number(button.dataset.second)));
  }

  has(kinds) {
    return this.bars.some(({ kind }) => kinds.includes(kind));
  }

  // The shares of the axis' width that a moment has.
  place(second) {
    return (second / this.seconds - this.from) / this.span;
  }

  secondAt(x) {
    const { left, width } = this.axis.getBoundingClientRect();
    const share = this.from + (this.span * (x - left)) / width;
    return this.seconds * Math.min(Math.max(share, 0), 1);
  }

  listen() {
    const pointers = new Map(), box = this.box;
    let start = null;
    box.addEventListener("pointerdown", (event) => {
      if (event.target.closest("button")) return;
      box.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event.clientX);
      start = event.shiftKey ? this.secondAt(event.clientX) : null;
      if (start === null && pointers.size === 1) this.seek(this.secondAt(event.clientX));
      this.tell(event);
    });
    box.addEventListener("pointermove", (event) => {
      if (!pointers.has(event.pointerId)) {
        if (event.pointerType === "mouse") this.hover(event);
        return;
      }
      const before = pointers.get(event.pointerId);
      const other = [...pointers].find(([id]) => id !== event.pointerId);
      pointers.set(event.pointerId, event.clientX);
      if (other) {
        const apart = (x) => Math.max(Math.abs(x - other[1]), 20);
        this.zoom(apart(event.clientX) / apart(before), this.secondAt((event.clientX + other[1]) / 2));
      } else if (start !== null) {
        this.setRange([start, this.secondAt(event.clientX)].sort((a, b) => a - b));
      } else this.seek(this.secondAt(event.clientX));
    });
    for (const name of ["pointerup", "pointercancel"])
      box.addEventListener(name, (event) => {
        pointers.delete(event.pointerId);
        if (start !== null && this.range && this.range[1] - this.range[0] < 2 / this.fps) this.setRange(null);
        start = null;
      });
    box.addEventListener("pointerleave", () => {
      this.pointer.hidden = true;
      this.read(this.second);
    });
    box.addEventListener(
      "wheel",
      (event) => {
        const head = event.target.closest(".bars, .time, .titles");
        if (event.ctrlKey || event.metaKey || (head && Math.abs(event.deltaY) >= Math.abs(event.deltaX))) {
          event.preventDefault();
          this.zoom(Math.exp(-0.002 * event.deltaY * (event.deltaMode ? 30 : 1)), this.secondAt(event.clientX));
        } else if (this.span < 1 && Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
          event.preventDefault();
          this.show(this.from + (this.span * event.deltaX) / this.axis.clientWidth, this.span);
        }
      },
      { passive: false },
    );
  }

  // Show the moment under the pointer: a line with its time, and the values there.
  hover(event) {
    const second = this.secondAt(event.clientX), { left, right } = this.axis.getBoundingClientRect();
    this.pointer.hidden = event.clientX < left || event.clientX > right;
    this.pointer.style.transform = `translateX(${event.clientX - this.box.getBoundingClientRect().left}px)`;
    this.pointer.firstChild.textContent = `${second.toFixed(2)} s`;
    this.read(second);
    this.tell(event);
  }

  // Say what a bar or a mark stands for.
  tell(event) {
    const bar = document.elementsFromPoint(event.clientX, event.clientY).find((item) => item.matches(".bars i"));
    if (bar) this.note.textContent = bar.title;
  }

  zoom(factor, about) {
    const span = Math.min(Math.max(this.span / factor, SMALLEST_SPAN / this.seconds), 1);
    const place = about / this.seconds;
    this.show(place - ((place - this.from) / this.span) * span, span);
  }

  // Show a part of the time, in shares of all of it.
  show(from, span) {
    this.span = Math.min(Math.max(span, 0.0001), 1);
    this.from = Math.min(Math.max(from, 0), 1 - this.span);
    this.root.style.setProperty("--from", this.from);
    this.root.style.setProperty("--span", this.span);
    const width = Number(this.root.dataset.width), height = Number(this.root.dataset.height);
    const box = `${this.from * width} 0 ${this.span * width} ${height}`;
    const step = TICKS.find((tick) => (this.span * this.seconds) / tick <= Math.max(this.axis.clientWidth / 70, 3)) || 600;
    const ticks = [];
    for (let k = Math.ceil((this.from * this.seconds) / step - 1e-6); k * step <= (this.from + this.span) * this.seconds + 1e-6; k++)
      ticks.push(k * step);
    const lines = ticks.map((tick) => `M${((tick / this.seconds) * width).toFixed(0)} 0V${height}`).join("");
    for (const plot of this.box.querySelectorAll(".plot > svg")) {
      plot.setAttribute("viewBox", box);
      plot.querySelector(".grid").setAttribute("d", `${lines}M0 0H${width}`);
    }
    for (const old of this.axis.querySelectorAll("span")) old.remove();
    for (const tick of ticks) {
      const label = document.createElement("span");
      label.textContent = Number(tick.toFixed(2));
      label.style.left = `${100 * this.place(tick)}%`;
      this.axis.append(label);
    }
    this.mark();
  }

  setRange(range) {
    this.range = range;
    this.setLoop(range);
    this.mark();
  }

  // Show a moment: the cursor, and the values there.
  at(second, playing) {
    this.second = second;
    const place = this.place(second);
    if (playing && this.span < 1 && (place < 0 || place > 1)) this.show(second / this.seconds - 0.05 * this.span, this.span);
    this.mark();
    this.read(second);
  }

  mark() {
    const box = this.box.getBoundingClientRect(), axis = this.axis.getBoundingClientRect();
    const x = (second) => axis.left - box.left - this.box.clientLeft + axis.width * this.place(second);
    const place = this.place(this.second);
    this.cursor.style.transform = `translateX(${x(this.second)}px)`; // Its own layer: curves are not drawn again.
    this.cursor.hidden = place < -1e-9 || place > 1 + 1e-9;
    this.rangeMark.hidden = !this.range;
    if (!this.range) return;
    const [left, right] = this.range.map((second) => x(this.seconds * Math.min(Math.max(second / this.seconds, this.from), this.from + this.span)));
    Object.assign(this.rangeMark.style, { left: `${left}px`, width: `${Math.max(right - left, 0)}px` });
  }

  read(second) {
    for (const curve of this.values) {
      const value = curve.at(second, 0.6 / this.fps);
      const text = value === null ? "" : String(Number(value.toPrecision(3)));
      if (curve.output.textContent !== text) curve.output.textContent = text;
    }
  }

  // Return the start of the next bar of some kinds after a moment, or of the one before it; null where there is none.
  neighbour(kinds, second, way) {
    const starts = this.bars.filter(({ kind }) => kinds.includes(kind)).map(({ start }) => start);
    const beyond = starts.filter((start) => way * (start - second) > 0.5 / this.fps);
    return beyond.length ? way * Math.min(...beyond.map((start) => way * start)) : null;
  }
}
