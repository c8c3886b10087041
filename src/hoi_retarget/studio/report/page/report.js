"use strict";
// Sorts and filters the table of all motions, and chooses its columns. Without this script the table has the worst
// motions. Of many rows the others are text until there is time to read them, and in the table once they are scrolled to.
(() => {
  const table = document.getElementById("motions");
  if (!table) return;
  const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells], find = document.getElementById("find");
  const words = find.querySelector("input"), count = find.querySelector("output"), between = document.getElementById("between");
  const choices = [...find.querySelectorAll("select")], further = document.getElementById("further");
  const texts = new Map(), PORTION = 100, later = window.requestIdleCallback ?? setTimeout;
  let rows = [...body.rows], fitting = rows, unread = [], order = null, range = null;
  const total = rows.length + (further ? Number(further.dataset.count) : 0);

  const read = (number) => {
    const holder = document.createElement("template");
    holder.innerHTML = `<table><tbody>${unread.splice(0, number).join("")}</tbody></table>`;
    rows.push(...holder.content.querySelectorAll("tr"));
  };
  const readOn = () => {
    if (!unread.length) return;
    read(PORTION);
    later(readOn);
  };
  const unpack = async () => {
    const letters = atob(further.textContent.trim()), bytes = new Uint8Array(letters.length);
    for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    unread = (await new Response(stream).text()).trim().split(/(?<=<\/tr>)\s*/);
    if (fitting === rows) readOn();
    else list(); // Somebody was quicker.
  };

  const text = (row) => {
    if (!texts.has(row)) texts.set(row, row.textContent.toLowerCase());
    return texts.get(row);
  };

  // The end of the table asks for more rows when it comes near.
  const end = document.createElement("div");
  table.after(end);
  const more = () => {
    if (fitting === rows && body.rows.length + PORTION > rows.length) read(PORTION);
    body.append(...fitting.slice(body.rows.length, body.rows.length + PORTION));
  };
  new IntersectionObserver(([{ isIntersecting }], watch) => {
    if (!isIntersecting || (body.rows.length >= fitting.length && !unread.length)) return;
    more();
    watch.unobserve(end);
    watch.observe(end);
  }, { rootMargin: "1500px" }).observe(end);
  const list = () => {
    read(unread.length);
    fitting = rows.filter(fits);
    if (order) fitting = sorted(fitting, order);
    body.replaceChildren();
    more();
    count.value = `${fitting.length} of ${total}`;
    between.hidden = !range;
    if (range) between.textContent = `${range.title} \u00d7`;
  };

  const key = (row, column) => {
    const cell = row.cells[column], value = cell.dataset.value;
    return value === undefined ? cell.textContent : value === "" ? null : Number(value);
  };
  const { compare: inWords } = new Intl.Collator("en", { numeric: true });
  const compare = (a, b) => (typeof a === "number" ? a - b : inWords(a, b));

  const sort = (column) => {
    const down = heads[column].getAttribute("aria-sort") === "ascending";
    for (const head of heads) head.removeAttribute("aria-sort");
    heads[column].setAttribute("aria-sort", down ? "descending" : "ascending");
    order = { column, down };
    list();
  };
  const sorted = (some, { column, down }) => {
    const keyed = some.map((row) => [key(row, column), row]);
    // What has no number comes last, either way.
    keyed.sort(([a], [b]) => a === null || b === null ? (a === null) - (b === null) : (down ? -1 : 1) * compare(a, b));
    return keyed.map(([, row]) => row);
  };

  const fits = (row) => {
    if (words.value && !text(row).includes(words.value.toLowerCase())) return false;
    for (const choice of choices)
      if (choice.value && !row.dataset[choice.dataset.of].split("\n").includes(choice.value)) return false;
    if (!range) return true;
    const value = key(row, range.column);
    return value !== null && value >= range.low && value <= range.high;
  };

  // Columns are hidden by one rule each: cells stay as they are.
  const sheet = document.createElement("style");
  document.head.append(sheet);
  const hide = () => {
    const hidden = heads.map((head, column) => ("hidden" in head.dataset ? column + 1 : 0)).filter(Boolean);
    sheet.textContent = hidden.map((column) => `#motions :is(td, th):nth-child(${column}) { display: none; }`).join("");
  };
  const show = (head, on) => {
    if (on) delete head.dataset.hidden;
    else head.dataset.hidden = "";
    hide();
  };
  heads.forEach((head, column) => {
    if (column) {
      const label = document.createElement("label"), box = document.createElement("input");
      Object.assign(box, { type: "checkbox", checked: !("hidden" in head.dataset) });
      box.addEventListener("change", () => show(head, box.checked));
      label.append(box, head.textContent);
      document.getElementById("columns").append(label);
      head.box = box;
    }
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    button.addEventListener("click", () => sort(column));
    head.append(button);
  });

  // A click on what is counted shows those motions.
  const choose = (event) => {
    const bar = event.target.closest("[data-filter], rect[data-figure]");
    if (!bar) return;
    if (bar.dataset.filter) {
      const choice = choices.find((each) => each.dataset.of === bar.dataset.filter);
      const option = choice && [...choice.options].find(({ value, text }) => [value, text].includes(bar.dataset.choice));
      if (!option) return;
      choice.value = option.value;
    } else {
      const column = heads.findIndex((head) => head.dataset.figure === bar.dataset.figure);
      if (column < 0) return;
      const ends = [bar.dataset.from, bar.dataset.to].map((end) => (end === "" ? null : Number(end)));
      const down = ends[0] !== null && ends[1] !== null ? ends[0] > ends[1] : bar.dataset.down === "1";
      const [low, high] = down ? [ends[1], ends[0]] : ends;
      range = { column, low: low ?? -Infinity, high: high ?? Infinity, title: `${heads[column].textContent}: one bar` };
      heads[column].box.checked = true;
      show(heads[column], true);
    }
    list();
    document.getElementById("all").scrollIntoView();
  };
  document.addEventListener("click", choose);
  between.addEventListener("click", () => {
    range = null;
    list();
  });
  words.addEventListener("input", list);
  for (const choice of choices) choice.addEventListener("change", list);
  find.hidden = false;
  document.body.classList.add("answers");
  hide();
  count.value = `${total} of ${total}`;
  if (words.value || choices.some((choice) => choice.value)) list(); // A browser that goes back fills them again.
  if (further) unpack();
})();
