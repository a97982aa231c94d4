"use strict";
// Tables sort by a click on a heading, sections by the list above them. Without this script the page is complete.
const number = (element) => parseFloat(element?.dataset.value ?? "NaN");

function compare(a, b, way) { // missing values last, whichever way
  const text = Number.isNaN(a.value) && Number.isNaN(b.value);
  if (text) return way * a.text.localeCompare(b.text, undefined, { numeric: true });
  if (Number.isNaN(a.value) || Number.isNaN(b.value)) return Number.isNaN(a.value) ? 1 : -1;
  return way * (a.value - b.value);
}

function sortTable(table, column) {
  const heading = table.tHead.rows[0].cells[column];
  const first = heading.dataset.first ?? "ascending"; // the better values above, at the first click
  const other = first === "ascending" ? "descending" : "ascending";
  const order = heading.ariaSort === first ? other : first;
  for (const cell of table.tHead.rows[0].cells) cell.removeAttribute("aria-sort");
  heading.setAttribute("aria-sort", order);
  const key = (row) => ({ row, value: number(row.cells[column]), text: row.cells[column].textContent });
  const rows = Array.from(table.tBodies[0].rows, key);
  rows.sort((a, b) => compare(a, b, order === "ascending" ? 1 : -1));
  table.tBodies[0].append(...rows.map((each) => each.row));
}

for (const table of document.querySelectorAll("table")) {
  if (!table.tHead || table.tBodies[0].rows.length < 2) continue;
  Array.from(table.tHead.rows[0].cells).forEach((cell, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...cell.childNodes);
    cell.append(button);
    button.addEventListener("click", () => sortTable(table, column));
  });
}

for (const list of document.querySelectorAll(".order select")) {
  list.addEventListener("change", () => {
    const [score, way] = list.value.split(" ");
    const box = document.getElementById(list.dataset.sections);
    const key = (node, index) => ({ node, value: score ? parseFloat(node.dataset[score]) : index, text: node.id });
    const sections = Array.from(box.children, key);
    if (!score) sections.sort((a, b) => a.node.dataset.place - b.node.dataset.place);
    else sections.sort((a, b) => compare(a, b, way === "up" ? 1 : -1));
    box.append(...sections.map((each) => each.node));
  });
  list.closest(".order").hidden = false;
}
