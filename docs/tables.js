// On a phone a row of a table stands as a list (extra.css): every cell then names its column.
for (const table of document.querySelectorAll(".md-typeset table:not([class])")) {
  const names = [...table.querySelectorAll("thead th")].map((th) => th.textContent.trim());
  for (const row of table.querySelectorAll("tbody tr"))
    [...row.cells].forEach((cell, k) => { cell.dataset.of = names[k] ?? ""; });
}
