// The table of docs/atlas.md: sorted by a click on a heading, filtered by words and by choice. A line opens
// to what its verdict rests on, and to the command that makes its report.
document.addEventListener("DOMContentLoaded", () => {
  const place = document.getElementById("atlas");
  const atlas = window.ATLAS;
  if (!place || !atlas) return;
  const columns = ["model", "integrator", "motion", "verdict", "speeds", "step (s)", "error per joule", "order", "largest step (s)"];
  const rows = atlas.rows.map(([m, s, o, v, ...rest]) => [
    atlas.model[m], atlas.solver[s], atlas.motion[o], atlas.verdict[v], ...rest]);
  const pictures = atlas.pictures;
  const places = new Map(pictures.models.map((model, k) => [model, k]));
  const sheet = new URL("../images/atlas-models.webp", document.querySelector("script[src$='assets/atlas.js']").src);
  const shown = 200, order = [0, 1, 3, 6, 7, 8, 2, 5, 4];  // what decides comes first
  let key = 0, sign = 1;

  const element = (name, properties = {}, ...children) => {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
  };
  const choice = (label, values) => {
    const select = element("select", { ariaLabel: label }, element("option", { value: "", textContent: label }),
      ...values.map(value => element("option", { value, textContent: value })));
    select.onchange = draw;
    return select;
  };
  const words = element("input", { type: "search", placeholder: "model", ariaLabel: "words of the model's path", oninput: draw });
  const filters = [choice("every integrator", atlas.solver), choice("every motion", atlas.motion), choice("every verdict", atlas.verdict)];
  const count = element("p", { className: "atlas-count", ariaLive: "polite" });
  const head = element("tr", {}, ...order.map(k => {
    const button = element("button", { textContent: columns[k], onclick: () => { sign = key === k ? -sign : 1; key = k; draw(); } });
    return element("th", { scope: "col" }, button);
  }));
  const body = element("tbody");
  const picture = model => {
    const k = places.get(model), box = element("span", { className: "atlas-picture", role: "img", ariaLabel: "" });
    box.style.width = `${pictures.width}px`;
    box.style.height = `${pictures.height}px`;
    if (k !== undefined) {
      box.style.backgroundImage = `url(${sheet})`;
      box.style.backgroundPosition = `-${k % pictures.columns * pictures.width}px -${Math.floor(k / pictures.columns) * pictures.height}px`;
    }
    return box;
  };
  const details = row => {
    const command = `python benchmarks/atlas/run.py benchmarks/atlas/plan.toml --only ${row[10]} --report run.html`;
    const copy = element("button", { className: "md-button", textContent: "Copy", onclick: () => {
      navigator.clipboard.writeText(command);
      copy.textContent = "Copied";
    } });
    const cell = element("td", { colSpan: columns.length });
    cell.append(element("div", { className: "atlas-details" }, picture(row[0]), element("div", {},
      element("p", { textContent: row[0] }), atlas.why[row[9]] ? element("p", { textContent: atlas.why[row[9]] }) : "",
      element("p", {}, "The report of this run, with the motion: ", element("code", { textContent: command }), " ", copy))));
    return element("tr", { className: "atlas-open" }, cell);
  };
  const open = (line, row, button) => {
    const isOpen = line.nextSibling && line.nextSibling.className === "atlas-open";
    if (isOpen) line.nextSibling.remove(); else line.after(details(row));
    button.ariaExpanded = String(!isOpen);
  };
  const name = row => {
    const parts = row[0].split("/");
    const button = element("button", { className: "atlas-name", ariaExpanded: "false" }, picture(row[0]),
      element("span", {}, parts[parts.length - 1].replace(/^(robot|model)\./, `${parts[parts.length - 2]} $&`),
        element("small", { textContent: parts[0] })));
    button.onclick = () => open(button.closest("tr"), row, button);
    return element("td", {}, button);
  };
  const number = x => x === null ? "" : x !== 0 && (Math.abs(x) < 1e-3 || Math.abs(x) >= 1e4) ? x.toExponential(1) : String(x);

  function draw() {
    const parts = words.value.toLowerCase().split(/\s+/).filter(Boolean);
    const own = rows.filter(row => parts.every(part => row[0].toLowerCase().includes(part)) &&
      filters.every((filter, k) => !filter.value || row[k + 1] === filter.value));
    own.sort((a, b) => {
      const x = a[key], y = b[key];
      if (x === null || y === null) return (x === null) - (y === null);  // what is not known stays last
      return sign * (typeof x === "number" ? x - y : x.localeCompare(y));
    });
    [...head.children].forEach((cell, place) => cell.ariaSort = order[place] !== key ? "none" : sign > 0 ? "ascending" : "descending");
    body.replaceChildren(...own.slice(0, shown).map(row => element("tr", { title: atlas.why[row[9]] }, name(row),
      ...order.slice(1).map(k => {
        return element("td", { className: k > 3 ? "number" : k === 3 ? row[3].replace(" ", "-") : "",
          textContent: typeof row[k] === "number" || row[k] === null ? number(row[k]) : row[k] });
      }))));
    count.textContent = `${own.length} of ${rows.length}${own.length > shown ? `, the first ${shown} shown` : ""}`;
  }
  place.replaceChildren(element("div", { className: "atlas-filters" }, words, ...filters), count,
    element("div", { className: "atlas-scroll", tabIndex: 0 },
      element("table", { className: "atlas" }, element("thead", {}, head), body)));
  draw();
});
