// Gives every folded table a field that shows only the rows with what is typed, such as "failed".
for (const details of document.querySelectorAll("details")) {
  const rows = details.querySelectorAll("tbody tr"), summary = details.querySelector("summary");
  if (rows.length < 4) continue;
  const field = document.createElement("input");
  Object.assign(field, { type: "search", placeholder: "filter rows", className: "screen filter" });
  field.setAttribute("aria-label", `filter rows of: ${summary.textContent}`);
  field.oninput = () => {
    const wanted = field.value.toLowerCase();
    for (const row of rows) row.hidden = !row.textContent.toLowerCase().includes(wanted);
  };
  summary.after(field);
}
