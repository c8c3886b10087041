"use strict";
// Sorts and filters the table of all motions, and chooses its columns. Without this script the table is as it was
// written: the worst first.
(() => {
  const table = document.getElementById("motions");
  if (!table) return;
  const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells], find = document.getElementById("find");
  const words = find.querySelector("input"), count = find.querySelector("output"), between = document.getElementById("between");
  const choices = [...find.querySelectorAll("select")];
  const texts = new Map([...body.rows].map((row) => [row, row.textContent.toLowerCase()]));
  let range = null;

  const key = (row, column) => {
    const cell = row.cells[column], value = cell.dataset.value;
    return value === undefined ? cell.textContent : value === "" ? null : Number(value);
  };
  const compare = (a, b) => typeof a === "number" ? a - b : a.localeCompare(b, "en", { numeric: true });

  const sort = (column) => {
    const down = heads[column].getAttribute("aria-sort") === "ascending";
    for (const head of heads) head.removeAttribute("aria-sort");
    heads[column].setAttribute("aria-sort", down ? "descending" : "ascending");
    const keyed = [...body.rows].map((row) => [key(row, column), row]);
    // What has no number comes last, either way.
    keyed.sort(([a], [b]) => a === null || b === null ? (a === null) - (b === null) : (down ? -1 : 1) * compare(a, b));
    body.append(...keyed.map(([, row]) => row));
  };

  const fits = (row) => {
    if (!texts.get(row).includes(words.value.toLowerCase())) return false;
    for (const choice of choices)
      if (choice.value && !row.dataset[choice.dataset.of].split("\n").includes(choice.value)) return false;
    if (!range) return true;
    const value = key(row, range.column);
    return value !== null && value >= range.low && value <= range.high;
  };
  const filter = () => {
    let shown = 0;
    for (const row of body.rows) {
      row.hidden = !fits(row);
      shown += !row.hidden;
    }
    count.value = `${shown} of ${body.rows.length}`;
    between.hidden = !range;
    if (range) between.textContent = `${range.title} \u00d7`;
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
    filter();
    document.getElementById("all").scrollIntoView();
  };
  document.addEventListener("click", choose);
  between.addEventListener("click", () => {
    range = null;
    filter();
  });
  words.addEventListener("input", filter);
  for (const choice of choices) choice.addEventListener("change", filter);
  find.hidden = false;
  document.body.classList.add("answers");
  hide();
  filter();
})();
