"use strict";
// Sorts and filters the table of all motions. Without this script the table is as it was written: the worst first.
(() => {
  const table = document.getElementById("motions");
  if (!table) return;
  const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells], find = document.getElementById("find");
  const words = find.querySelector("input"), level = find.querySelector("select"), count = find.querySelector("output");

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

  const filter = () => {
    const wanted = words.value.toLowerCase();
    let shown = 0;
    for (const row of body.rows) {
      const level_fits = !level.value || row.cells[0].textContent === level.value;
      row.hidden = !(level_fits && row.textContent.toLowerCase().includes(wanted));
      shown += !row.hidden;
    }
    count.value = `${shown} of ${body.rows.length}`;
  };

  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    button.addEventListener("click", () => sort(column));
    head.append(button);
  });
  words.addEventListener("input", filter);
  level.addEventListener("change", filter);
  find.hidden = false;
  filter();
})();
