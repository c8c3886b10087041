// The page: its controls, its keys, and one drawing after the other.

// Presets of the camera: angle from the front, and height [rad].
const STANDS = { front: [0, 0.1], side: [Math.PI / 2, 0.1], back: [Math.PI, 0.1], top: [0, 1.5] };

async function start(description) {
  const element = (id) => document.getElementById(id);
  const canvas = element("picture"), slider = element("time"), button = element("play"), speed = element("speed");
  const follow = element("follow"), look = element("look"), through = element("through"), clock = element("clock");
  const arrange = element("arrange"), labels = element("labels");
  const { fps, seconds } = description;
  const picture = new Picture(canvas, description, await unpacked(description.numbers));
  let second = 0, playing = true, before = null, stale = true, views = [], loop = null, shoot = null, held = false;
  const onDraw = []; // Receive each view that was drawn, its matrix, and its figures.
  const camera = new Camera(canvas, description.camera, () => (stale = true));

  const seek = (value) => {
    second = Math.min(Math.max(value, 0), seconds);
    stale = true;
  };
  const play = (on) => {
    if (on && second >= seconds) seek(0);
    playing = on;
    before = null;
    stale = true;
    button.textContent = on ? "\u275A\u275A" : "\u25B6";
    button.setAttribute("aria-label", on ? "Pause" : "Play");
  };
  const goTo = (value) => {
    play(false);
    seek(value);
  };
  const timeline = new Timeline(element("curves"), { seconds, fps, seek: goTo, loop: (range) => {
    loop = range;
    element("loop").setAttribute("aria-pressed", String(Boolean(range)));
  } });
  const jump = (kinds, way) => {
    const to = timeline.neighbour(kinds, second, way);
    if (to !== null) goTo(to);
  };

  // Lay out who is drawn where; the camera fits to the first view.
  const lay = () => {
    const places = views.map(({ place }) => place);
    views = picture.views(arrange.value).map((view, index) => ({ ...view, place: places[index] }));
    const ratio = canvas.width / canvas.clientWidth;
    if (views.length) camera.view = { name: arrange.value, width: views[0].width / ratio, height: views[0].height / ratio };
    const named = arrange.value === "beside" || (arrange.value === "floor" && picture.subjects.length > 2);
    labels.replaceChildren();
    for (const view of views)
      for (const figure of named ? view.figures : []) {
        figure.label = document.createElement("span");
        figure.label.textContent = figure.subject.title;
        labels.append(figure.label);
        if (arrange.value === "beside") Object.assign(figure.label.style, { left: `${view.x / ratio}px`, top: `${view.y / ratio}px` });
        else figure.label.className = "standing";
      }
    stale = true;
  };
  const stand = () => {
    lay();
    if (look.value) camera.approach(description.close);
    else camera.reset();
  };

  const drawViews = () => {
    picture.show(second);
    for (const view of views) {
      const middle = picture.centre(view, second), still = picture.centre(view, 0);
      if (!held || !view.place) view.place = (look.value && picture.look(view, look.value, second)) || (follow.checked ? middle : still);
      const seen = picture.draw(view, camera.around(view.place), middle, picture.reaches[arrange.value === "floor" ? "floor" : "each"]);
      for (const act of onDraw) act(view, seen);
      for (const { subject, shift, label } of view.figures)
        if (label && label.className) {
          const at = subject.centre.at(second * subject.fps).map((x, i) => (i < 2 ? x + shift[i] : 0));
          const [x, y, , w] = [0, 1, 2, 3].map((row) => seen[row] * at[0] + seen[4 + row] * at[1] + seen[8 + row] * at[2] + seen[12 + row]);
          Object.assign(label.style, { left: `${50 + (50 * x) / w}%`, top: `${50 - (50 * y) / w}%` });
        }
    }
  };

  const draw = (now) => {
    if (playing && before !== null) {
      const next = second + (Number(speed.value) * (now - before)) / 1000;
      const [first, last] = loop || [0, seconds];
      seek(next > last || next < first - 0.5 / fps ? first : next);
    }
    before = now;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if ((canvas.width !== width || canvas.height !== height) && width && height) {
      [canvas.width, canvas.height] = [width, height];
      lay();
      if (!camera.turned && !look.value) camera.reset();
      timeline.show(timeline.from, timeline.span);
    }
    if (stale && width && height) {
      stale = false;
      drawViews();
      if (shoot) shoot();
      shoot = null;
      const frame = Math.round(second * fps);
      slider.value = frame;
      clock.textContent = `${second.toFixed(2)} s \u00b7 frame ${frame}`;
      timeline.at(second, playing);
    }
    requestAnimationFrame(draw);
  };

  slider.max = Math.round(seconds * fps);
  slider.addEventListener("input", () => goTo(slider.value / fps));
  button.addEventListener("click", () => play(!playing));
  follow.addEventListener("change", () => (stale = true));
  const lookAt = (index) => {
    if (index >= look.options.length) return;
    look.selectedIndex = index;
    if (look.value) camera.approach(description.close);
    else camera.reset();
  };
  const looks = new Set(picture.subjects.filter((item) => !item.human).flatMap((item) => [...item.looks.keys()]));
  if (!looks.size) for (const item of picture.subjects) for (const name of item.looks.keys()) looks.add(name);
  for (const name of looks) look.append(new Option(name, name));
  look.addEventListener("change", () => lookAt(look.selectedIndex));
  through.addEventListener("change", () => {
    picture.seeThrough(through.checked);
    stale = true;
  });
  canvas.addEventListener("dblclick", () => lookAt(0));
  element("home").addEventListener("click", () => lookAt(0));
  for (const name of Object.keys(STANDS)) element(name).addEventListener("click", () => camera.stand(...STANDS[name]));
  arrange.value = picture.subjects.length > 2 ? "beside" : "floor";
  arrange.closest("label").hidden = picture.subjects.length < 2;
  arrange.addEventListener("change", stand);

  const toggleLoop = () => {
    const all = timeline.span > 0.999;
    const near = [Math.max(second - 1, 0), Math.min(second + 1, seconds)];
    const seen = [timeline.from * seconds, (timeline.from + timeline.span) * seconds];
    timeline.setRange(timeline.range ? null : all ? near : seen);
    if (timeline.range) play(true);
  };
  const stem = document.title.replace(/[^\w.-]+/g, "-");
  const actions = {
    "contact-before": () => jump(["contact"], -1),
    "contact-next": () => jump(["contact"], 1),
    "warning-before": () => jump(["warning", "error"], -1),
    "warning-next": () => jump(["warning", "error"], 1),
    wider: () => timeline.zoom(0.5, second),
    closer: () => timeline.zoom(2, second),
    whole: () => timeline.show(0, 1),
    loop: toggleLoop,
    shot: () => {
      shoot = () => canvas.toBlob((blob) => blob && keep(blob, `${stem}-${second.toFixed(2)}s.png`));
      stale = true;
    },
    record: recorder(canvas, element("record"), (blob, ending) => keep(blob, `${stem}.${ending}`)),
    link: () => {
      const range = loop ? loop.map((value) => value.toFixed(2)).join(",") : second.toFixed(2);
      history.replaceState(null, "", `#t=${range}`);
      if (navigator.clipboard) navigator.clipboard.writeText(location.href).catch(() => {});
    },
  };
  for (const [name, act] of Object.entries(actions)) element(name).addEventListener("click", act);
  const findJumps = () => {
    for (const [name, kinds] of [["contact", ["contact"]], ["warning", ["warning", "error"]]])
      for (const way of ["before", "next"]) element(`${name}-${way}`).disabled = !timeline.has(kinds);
  };
  findJumps();

  const keys = { c: "contact-next", C: "contact-before", w: "warning-next", W: "warning-before", "+": "closer", "-": "wider", 0: "whole", l: "loop" };
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("input, select") || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === " " && event.target.closest("button, a, summary")) return; // It presses them.
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === " ") play(!playing);
    else if (event.key === "x") through.click();
    else if (event.key === "Home" || event.key === "End") goTo(event.key === "Home" ? 0 : seconds);
    else if (event.key === "Escape") timeline.setRange(null);
    else if (event.key >= "1" && event.key <= "9") lookAt(Number(event.key) - 1);
    else if (keys[event.key]) actions[keys[event.key]]();
    else if (step) goTo((Math.round(second * fps) + step) / fps);
    else return;
    event.preventDefault();
  });

  const box = (name, meaning, checked, change) => {
    const label = document.createElement("label"), input = document.createElement("input");
    Object.assign(input, { type: "checkbox", checked });
    label.title = meaning;
    input.addEventListener("change", () => {
      change(input.checked);
      stale = true;
    });
    label.append(input, name);
    return label;
  };
  const listLayers = () => {
    element("figures").replaceChildren();
    element("layers").replaceChildren();
    if (picture.subjects.length > 1)
      picture.subjects.forEach((subject, index) => {
        const change = (on) => {
          picture.subjects[index].shown = on;
          lay();
        };
        element("figures").append(box(subject.title, `All that belongs to ${subject.title}`, subject.shown, change));
      });
    for (const [name, [first]] of picture.layers())
      element("layers").append(box(name, first.meaning, first.shown, (on) => picture.showLayer(name, on)));
  };
  listLayers();
  if (window.innerWidth < 700 || window.innerHeight < 950) element("show").open = false;

  // A link can carry a moment, or a range to play over and over.
  const carried = () => {
    const [first, last] = (/^#t=([\d.]+)(?:,([\d.]+))?$/.exec(location.hash) || []).slice(1).map(Number);
    if (!(first >= 0)) return false;
    if (last > first) timeline.setRange([Math.min(first, seconds), Math.min(last, seconds)]);
    seek(first);
    play(last > first);
    return true;
  };
  window.addEventListener("hashchange", carried);
  if (!carried()) play(true);
  requestAnimationFrame(draw);

  return {
    picture, timeline, camera, onDraw, play, goTo, lookAt, fps,
    at: () => second,
    looks: () => [...look.options].map((option) => option.value),
    // The camera stays where it is, whatever it follows.
    hold: (on) => (held = on),
    draw: () => (stale = true),
    showLayer: (name, on) => {
      picture.showLayer(name, on);
      listLayers();
      stale = true;
    },
    // Show another scene of the same subjects.
    redraw: async (other) => {
      picture.adopt(other, await unpacked(other.numbers));
      lay();
    },
    // Show other curves; `complete` adds bars to them.
    chart: (html, complete) => {
      element("charts").innerHTML = html;
      complete();
      timeline.adopt();
      timeline.show(timeline.from, timeline.span);
      timeline.at(second, false);
      findJumps();
      listLayers();
    },
  };
}

function keep(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// Return what a button does that records the canvas until it is pressed again.
function recorder(canvas, button, done) {
  if (!window.MediaRecorder || !canvas.captureStream) button.hidden = true;
  let recording = null;
  return () => {
    if (recording) return recording.stop();
    const kind = ["video/mp4", "video/webm"].find((name) => MediaRecorder.isTypeSupported(name));
    const parts = [];
    recording = new MediaRecorder(canvas.captureStream(30), { mimeType: kind, videoBitsPerSecond: 8e6 });
    recording.addEventListener("dataavailable", (event) => parts.push(event.data));
    recording.addEventListener("stop", () => {
      recording = null;
      button.setAttribute("aria-pressed", "false");
      done(new Blob(parts, { type: kind }), kind.slice(6));
    });
    recording.start();
    button.setAttribute("aria-pressed", "true");
  };
}

// Other scripts of a page go on from it.
const started = start(JSON.parse(document.getElementById("scene").textContent)).catch((error) => {
  const note = document.getElementById("trouble");
  note.textContent = `The scene cannot be shown here. ${error.message || error} A current browser is needed.`;
  note.hidden = false;
});
