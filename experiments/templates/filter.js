// Gives every folded or long table a field that shows only the rows with what is typed, such as "failed".
for (const box of document.querySelectorAll(".scroll")) {
  const rows = box.querySelectorAll("tbody tr"), summary = box.parentElement.querySelector(":scope > summary");
  if (rows.length < (summary ? 4 : 30)) continue;
  const field = document.createElement("input");
  Object.assign(field, { type: "search", placeholder: "filter rows", className: "screen filter" });
  field.setAttribute("aria-label", `filter rows of: ${box.getAttribute("aria-label")}`);
  field.oninput = () => {
    const wanted = field.value.toLowerCase();
    for (const row of rows) row.hidden = !row.textContent.toLowerCase().includes(wanted);
  };
  box.before(field);
}
