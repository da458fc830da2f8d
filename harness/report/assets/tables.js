"use strict";
document.documentElement.classList.add("scripted");

// Tables: a click on a column's head sorts by it, buttons copy the whole table.
(function () {
  function key(cell) {
    const raw = cell.dataset.v;
    if (raw === undefined) return cell.textContent.trim();
    return raw === "inf" ? Infinity : raw === "-inf" ? -Infinity : Number(raw);
  }
  function compare(a, b) {
    if (typeof a === "number" && typeof b === "number") return a - b;
    if (typeof a === "number") return -1; // a number before none
    if (typeof b === "number") return 1;
    return a.localeCompare(b, "en", { numeric: true });
  }
  function sort(table, column, head) {
    const up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const rows = Array.from(table.tBodies[0].rows).map((row) => [key(row.cells[column]), row]);
    rows.sort((a, b) => (up ? 1 : -1) * compare(a[0], b[0]));
    table.tBodies[0].append(...rows.map((pair) => pair[1]));
  }
  async function copy(text, button) {
    let done = false;
    try {
      await navigator.clipboard.writeText(text);
      done = true;
    } catch {
      const area = document.createElement("textarea");
      area.value = text;
      document.body.append(area);
      area.select();
      done = document.execCommand("copy");
      area.remove();
      button.focus();
    }
    const before = button.textContent;
    button.textContent = done ? "Copied" : "Could not copy";
    setTimeout(() => { button.textContent = before; }, 1500);
  }
  for (const figure of document.querySelectorAll("figure.table")) {
    const table = figure.querySelector("table");
    Array.from(table.tHead.rows[0].cells).forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = head.textContent;
      button.addEventListener("click", () => sort(table, column, head));
      head.replaceChildren(button);
    });
    const bar = document.createElement("div");
    bar.className = "copy";
    for (const [kind, label] of [["csv", "Copy as csv"], ["tex", "Copy as LaTeX"]]) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = label;
      button.dataset.kind = kind;
      button.addEventListener("click", async () => {
        const files = await window.report.load("tables");
        copy(files[figure.dataset.table][kind], button);
      });
      bar.append(button);
    }
    figure.querySelector(".wide").after(bar);
  }
  document.addEventListener("click", (event) => {
    const button = event.target.closest("button[data-copy]");
    if (button) copy(button.dataset.copy, button);
  });
})();
