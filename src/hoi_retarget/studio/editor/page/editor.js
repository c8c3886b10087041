// The editor: asks the server for changes, one after the other, and shows what it answers.

const COLOURS = { left_hand: "#0072b2", right_hand: "#d55e00", left_foot: "#009e73", right_foot: "#cc79a7" };
const IDLE = "#8c96a0", IN_AIR = "#ffe100";
const TYPING_MS = 600;

async function edit(player, { fixed, state }) {
  const element = (id) => document.getElementById(id);
  const told = element("told"), compared = element("compared"), turnToo = element("turn-too");
  let now = state, pinned = null, waiting = Promise.resolve(), preview = null, busy = 0;

  const frame = () => Math.min(Math.round(player.at() * player.fps), fixed.frames - 1);
  const chosen = () => (now.chosen === null ? null : now.segments[now.chosen]);
  const seconds = (at) => (at / player.fps).toFixed(2);
  // In words: from the first to the last frame, as the timeline has them, and as files of edits do.
  const span_text = (start, stop) => `${seconds(start)} to ${seconds(stop - 1)} s, frames ${start} to ${stop - 1}`;
  const say = (text, wrong = false) => {
    told.textContent = text;
    told.className = wrong ? "wrong" : "";
  };

  // Requests: one after the other. Of previews only the latest one is asked for.
  const send = async (request) => {
    if (state.copy) return { message: state.copy, wrong: true };
    const shown = { revision: now.revision, chosen: now.chosen, compared: compared.checked };
    if (pinned) shown.pinned = [pinned.person, pinned.part];
    try {
      const answer = await fetch("", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ ...shown, ...request }) });
      if (!answer.ok) throw new Error(await answer.text());
      return await answer.json();
    } catch (error) {
      return { message: `The server does not answer (${error.message}). Edits that were told of are kept.`, wrong: true };
    }
  };
  const inOrder = (work) => {
    const done = waiting.then(work);
    waiting = done.catch(() => {});
    return done;
  };
  const ask = (action, values = {}, words = "Solving ...") =>
    inOrder(async () => {
      document.body.classList.toggle("busy", ++busy > 0);
      if (words) say(words);
      const answer = await send({ action, ...values });
      if (answer.chart) {
        now = answer;
        await player.redraw(JSON.parse(answer.scene));
        player.chart(answer.chart, addBars);
        show();
      } else show();
      if (answer.message || words) say(answer.message, answer.wrong);
      document.body.classList.toggle("busy", --busy > 0);
    });
  const askPreview = (action, values) => {
    const first = preview === null;
    preview = { action, values };
    if (!first) return;
    inOrder(async () => {
      const latest = preview;
      preview = null;
      const answer = await send({ action: latest.action, ...latest.values });
      if (answer.scene) await player.redraw(JSON.parse(answer.scene));
      if (answer.air) answer.air.forEach((air, number) => now.segments[number] && (now.segments[number].air = air));
      paint();
      say(answer.message, answer.wrong);
    });
  };

  // An edit of the chosen contact, in the words of a file of edits.
  const change = (edit_of) => {
    const it = chosen();
    if (!it) return say("No contact is chosen. Choose a row or a point first.", true);
    return ask("edit", { edit: { ...edit_of(it), part: it.part, person: it.person } });
  };
  const of_chosen = {
    "start-here": (it) => ({ operation: "retime", frame: it.start, start: frame(), stop: it.stop }),
    "end-here": (it) => ({ operation: "retime", frame: it.start, start: it.start, stop: frame() + 1 }),
    split: (it) => ({ operation: "split", frame: it.start, at: frame() }),
    merge: (it) => ({ operation: "merge", frame: it.start }),
    "next-hold": (it) => ({ operation: "choose_hold", frame: it.start, rank: it.hold + 2 }),
    "hold-before": (it) => ({ operation: "choose_hold", frame: it.start, rank: Math.max(it.hold, 1) }),
    "one-point": (it) => ({ operation: "fix", frame: it.start }),
    "to-surface": (it) => ({ operation: "snap", frame: it.start }),
    delete: (it) => ({ operation: "delete", frame: it.start }),
  };
  const of_all = {
    "one-point-each": () => ask("edit", { edit: { operation: "fix_all" } }),
    "all-to-surface": () => ask("edit", { edit: { operation: "snap_all" } }),
    undo: () => ask("undo"),
    redo: () => ask("redo"),
    solve: () => ask("solve", {}, "Solving the whole clip ..."),
    save: () => ask("save", {}, ""),
    "save-result": () => ask("save_result", {}, "Solving the whole clip ..."),
    "save-as": () => ask("save_as", { name: element("version").value.trim() }, ""),
    recover: () => ask("recover"),
    add: () => {
      const { person, part } = fixed.touching[element("new-part").value];
      return ask("add", { part: [person, part], object: Number(element("new-object").value), frame: frame() });
    },
    unpin: () => {
      if (!pinned) return say("No part is chosen. Choose one beside Pin first.", true);
      return ask("edit", { edit: { operation: "unpin", part: pinned.part, person: pinned.person, frame: frame() } });
    },
  };
  for (const [id, edit_of] of Object.entries(of_chosen)) element(id).addEventListener("click", () => change(edit_of));
  for (const [id, act] of Object.entries(of_all)) element(id).addEventListener("click", act);

  // Numbers count as typed once they have stayed for a moment.
  const typed = (id, act) => {
    let timer = null;
    const inputs = [...element(id).querySelectorAll("input")];
    for (const input of inputs)
      input.addEventListener("input", () => {
        clearTimeout(timer);
        timer = setTimeout(() => {
          const values = inputs.map((each) => each.valueAsNumber);
          if (values.every(Number.isFinite)) act(values);
        }, TYPING_MS);
      });
    return (values) => inputs.forEach((input, index) => document.activeElement === input || (input.value = values[index]));
  };
  const setFrames = typed("frames", ([first, last]) => change((it) => ({ operation: "retime", frame: it.start, start: first, stop: last + 1 })));
  const rounded = (point) => point.map((x) => Number(x.toFixed(4)));
  const setPoint = typed("point", (point) =>
    // Coordinates that were shown rounded, and not typed over, stay.
    change((it) => ({ operation: "move", frame: it.start, offset: point.map((x, i) => (x === rounded(it.point)[i] ? 0 : Number((x - it.point[i]).toFixed(6)))) })),
  );
  const setTurn = typed("turn", (turn) => change((it) => ({ operation: "turn_hand", frame: it.start, turn })));

  // The panel.
  const option = (select, entries, keep = null) => {
    select.replaceChildren(...entries.map(([text, value]) => new Option(text, value)));
    if (keep !== null) select.value = keep;
  };
  option(element("new-part"), fixed.touching.map(({ name }, index) => [name, index]));
  option(element("new-object"), fixed.names.map((name, index) => [name, index]));
  element("new-contact").hidden = !fixed.names.length;
  option(element("pin"), [["nothing", ""], ...fixed.pinned.map(({ name }, index) => [name, index])]);
  const choosePinned = () => {
    pinned = element("pin").value === "" ? null : fixed.pinned[Number(element("pin").value)];
    if (pinned) lookAt(pinned);
    return ask("show", {}, "");
  };
  element("pin").addEventListener("change", choosePinned);
  turnToo.addEventListener("change", () => show());
  element("pins").addEventListener("change", () => {
    const pin = now.pins[Number(element("pins").value)];
    if (!pin) return;
    player.goTo(pin.frame / player.fps);
    element("pin").value = fixed.pinned.findIndex(({ person, part }) => person === pin.person && part === pin.part);
    choosePinned();
  });
  element("edits").addEventListener("change", () => ask("back", { count: Number(element("edits").value) }));
  element("load").addEventListener("change", () => ask("load", { name: element("load").value }));
  compared.addEventListener("change", () => {
    player.showLayer("before", compared.checked);
    return ask("show", {}, "");
  });

  // Go near to a part, where the player can.
  const lookAt = ({ part, name }) => {
    const plain = part.replace("_", " ");
    const look = player.looks().findIndex((text) => text === name || text === plain || text.startsWith(`${plain},`));
    if (look > 0) player.lookAt(look);
  };
  const choose = (number) => {
    const it = now.segments[number];
    if (!it) return;
    now.chosen = number;
    if (pinned) {
      element("pin").value = "";
      pinned = null;
    }
    lookAt(it);
    player.play(false);
    if (frame() < it.start || frame() >= it.stop) player.goTo(Math.floor((it.start + it.stop) / 2) / player.fps);
    show();
    say(`${it.name}, ${span_text(it.start, it.stop)}: ${it.off}.`);
  };

  const rows = () => {
    element("contacts").replaceChildren(
      ...now.segments.map((it, number) => {
        const row = document.createElement("button");
        row.type = "button";
        row.className = it.air ? "air" : "";
        row.setAttribute("aria-pressed", String(number === now.chosen));
        const dot = document.createElement("i");
        dot.style.background = COLOURS[it.part] || "#888";
        row.append(dot, `${it.name}  ${seconds(it.start)} - ${seconds(it.stop - 1)} s  (${it.off})`);
        row.addEventListener("click", () => choose(number));
        return row;
      }),
    );
  };
  const figures = () => {
    const cells = (texts, kind) =>
      texts.map((text) => {
        const cell = document.createElement(kind);
        cell.textContent = text;
        return cell;
      });
    const heads = document.createElement("tr");
    heads.append(...cells(["", "start", "before", "now"], "th"));
    element("values").replaceChildren(
      heads,
      ...now.figures.map((texts) => {
        const row = document.createElement("tr");
        row.append(...cells(texts, texts.length > 1 ? "td" : "th"));
        return row;
      }),
    );
  };

  // Contacts and pins over the curves; ends of contacts can be dragged.
  const bar = (start, stop, kind) => {
    const made = document.createElement("i"), last = Math.max(fixed.frames - 1, 1);
    made.className = kind;
    made.style.setProperty("--at", start / last);
    made.style.setProperty("--share", Math.max(stop - 1 - start, 0.5) / last);
    return made;
  };
  const addBars = () => {
    const found = new Map();
    const row = (name) => {
      if (!found.has(name)) {
        const made = document.createElement("div"), title = document.createElement("b");
        made.className = "bars own";
        title.textContent = name;
        made.append(title, document.createElement("div"));
        found.set(name, made);
      }
      return found.get(name).lastChild;
    };
    now.segments.forEach((it, number) => {
      const made = bar(it.start, it.stop, "contact");
      made.style.background = COLOURS[it.part] || "#888";
      made.title = `${it.name}: ${span_text(it.start, it.stop)}`;
      made.dataset.contact = number;
      made.classList.toggle("chosen", number === now.chosen);
      made.addEventListener("click", () => choose(number));
      for (const end of [0, 1]) made.append(endOf(number, end, made));
      row(it.name).append(made);
    });
    for (const pin of now.pins) {
      const made = bar(pin.frame, pin.frame + 1, "pinned");
      made.title = pin.text;
      row("pins").append(made);
    }
    document.querySelector("#charts .head").prepend(...found.values());
  };
  // The frames of a contact after one end was dragged: at least one, and none of the part's other contacts.
  const dragged = (number, end, to) => {
    const it = now.segments[number];
    const others = now.segments.filter((other) => other !== it && other.person === it.person && other.part === it.part);
    if (end === 0) {
      const free = Math.max(0, ...others.filter(({ stop }) => stop <= it.start).map(({ stop }) => stop));
      return [Math.min(Math.max(to, free), it.stop - 1), it.stop];
    }
    const limit = Math.min(fixed.frames, ...others.filter(({ start }) => start >= it.stop).map(({ start }) => start));
    return [it.start, Math.max(Math.min(to + 1, limit), it.start + 1)];
  };
  const endOf = (number, end, owner) => {
    const grip = document.createElement("u");
    grip.className = end ? "last" : "first";
    let span = null;
    grip.addEventListener("pointerdown", (event) => {
      event.stopPropagation();
      grip.setPointerCapture(event.pointerId);
      player.play(false);
      span = [now.segments[number].start, now.segments[number].stop];
    });
    grip.addEventListener("pointermove", (event) => {
      if (!span) return;
      span = dragged(number, end, Math.round(player.timeline.secondAt(event.clientX) * player.fps));
      const shown = bar(...span, "");
      for (const name of ["--at", "--share"]) owner.style.setProperty(name, shown.style.getPropertyValue(name));
      player.goTo((span[end] - end) / player.fps);
      say(`${now.segments[number].name}: ${span_text(...span)}`);
    });
    for (const name of ["pointerup", "pointercancel"])
      grip.addEventListener(name, (event) => {
        if (!span) return;
        const it = now.segments[number], [start, stop] = span;
        span = null;
        if (event.type === "pointercancel" || (start === it.start && stop === it.stop)) return show();
        now.chosen = number;
        ask("edit", { edit: { operation: "retime", part: it.part, person: it.person, frame: it.start, start, stop } });
      });
    grip.addEventListener("click", (event) => event.stopPropagation());
    return grip;
  };

  // Handles: the chosen contact has one, or the part that is pinned.
  const inWorld = (index, at, local) => {
    const { scale, positions, quats } = fixed.objects[index];
    return turns.apply(quats[at], local.map((x) => scale * x)).map((x, i) => x + positions[at][i]);
  };
  const handles = new Handles(document.querySelector(".stage"), player, {
    choose,
    grab: () => player.play(false),
    pull: (target, at, moved, released) => target.pull(at, moved, released),
  });
  const contactTarget = (it) => {
    const turn = it.turn.map((x) => (x * Math.PI) / 180);
    return {
      turns: it.turns,
      place: (at) => inWorld(it.object, at, it.point),
      quat: (at) => turns.times(fixed.objects[it.object].quats[at], turns.of(turn)),
      pull: (at, { place, quat, turned }, released) => {
        const { scale, positions, quats } = fixed.objects[it.object];
        const back = turns.back(quats[at]);
        const point = turns.apply(back, place.map((x, i) => (x - positions[at][i]) / scale));
        const values = { point, on_surface: element("on-surface").checked };
        if (turned) values.turn = turns.vector(turns.times(back, quat)).map((x) => (x * 180) / Math.PI);
        return released ? ask("move", values) : askPreview("preview_move", values);
      },
    };
  };
  const pinTarget = (part, { positions, quats }) => ({
    turns: turnToo.checked,
    place: (at) => positions[at],
    quat: (at) => quats[at],
    pull: (at, { place, quat }, released) => {
      const values = { part: [part.person, part.part], frame: at, point: place };
      if (turnToo.checked) values.quat = quat;
      return released ? ask("pin", values) : askPreview("preview_pin", values);
    },
  });

  const colour = (it, number) => (it.air ? IN_AIR : number === now.chosen ? "#ff8c00" : COLOURS[it.part] || IDLE);
  const paint = () => handles.balls.forEach((ball, number) => ball.setAttribute("fill", colour(now.segments[number], number)));
  const show = () => {
    const it = chosen();
    rows();
    figures();
    element("of-chosen").disabled = !it;
    if (it) {
      setFrames([it.start, it.stop - 1]);
      setPoint(rounded(it.point));
      setTurn(it.turn);
      element("turn").hidden = !it.turns;
    }
    option(element("edits"), [["as recorded", 0], ...now.edits.map((text, index) => [text, index + 1])], now.edits.length);
    option(element("pins"), [[now.pins.length ? `${now.pins.length} pinned` : "none", ""], ...now.pins.map(({ text }, index) => [text, index])], "");
    option(element("load"), [["-", ""], ...now.versions.map((name) => [name, name])], "");
    element("recover").hidden = !now.recoverable;
    element("saved").textContent = now.unsaved ? "not saved yet" : "";
    for (const made of document.querySelectorAll("#charts i[data-contact]"))
      made.classList.toggle("chosen", Number(made.dataset.contact) === now.chosen);
    const points = now.segments.map((segment, number) => ({
      number,
      name: segment.name,
      colour: colour(segment, number),
      place: (at) => inWorld(segment.object, at, segment.point),
    }));
    handles.show(points, pinned && now.handle ? pinTarget(pinned, now.handle) : it ? contactTarget(it) : null);
  };

  document.addEventListener("keydown", (event) => {
    if (event.target.closest("input[type=text]") && event.key !== "s") return;
    const key = event.key.toLowerCase();
    if ((event.ctrlKey || event.metaKey) && !event.altKey) {
      if (key === "z" && !event.shiftKey) of_all.undo();
      else if (key === "y" || (key === "z" && event.shiftKey)) of_all.redo();
      else if (key === "s") of_all.save();
      else return;
    } else if (key === "b" && !event.target.closest("input, select")) compared.click();
    else return;
    event.preventDefault();
  });
  window.addEventListener("beforeunload", (event) => busy && event.preventDefault());

  element("show").open = false; // The panel has what is needed.
  player.play(false);
  player.chart(element("charts").innerHTML, addBars);
  show();
  say(state.message);
}

started.then((player) => player && edit(player, JSON.parse(document.getElementById("work").textContent)));
