// Tables, words, source code, findings.

import type { Code, Grid, Links, Told, Words } from "./data";
import { el } from "./dom";

export function grid(table: Grid): HTMLElement {
  const head = el("tr");
  const body = el("tbody");
  const rows = table.rows.map((cells) => {
    const row = el("tr", cells.length ? {} : { class: "rule" });
    if (!cells.length) row.append(el("td", { colspan: table.heads.length }));
    cells.forEach((cell, k) => row.append(el("td", { class: table.numeric[k] ? "numeric" : undefined }, cell)));
    body.append(row);
    return row;
  });
  let sorted = -1, ascending = true;
  table.heads.forEach((name, k) => {
    const cell = el("th", { scope: "col", "aria-sort": "none", class: table.numeric[k] ? "numeric" : undefined });
    cell.append(el("button", {
      type: "button", title: "Sort by this column",
      click: () => {
        ascending = sorted === k ? !ascending : true;
        sorted = k;
        const full = table.rows.map((cells, i) => ({ cells, row: rows[i]! })).filter(({ cells }) => cells.length);
        full.sort((a, b) => compared(a.cells[k]!, b.cells[k]!) * (ascending ? 1 : -1));
        body.replaceChildren(...full.map(({ row }) => row));
        for (const other of head.children) other.setAttribute("aria-sort", "none");
        cell.setAttribute("aria-sort", ascending ? "ascending" : "descending");
      },
    }, name || "\u00a0"));
    head.append(cell);
  });
  const content = el("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": table.title || "table" }, el("table", {}, el("thead", {}, head), body));
  if (table.folded) return el("details", { class: "panel" }, el("summary", {}, table.title), content);
  return el("div", { class: "panel" }, table.title && el("h3", {}, table.title), content);
}

function compared(a: string, b: string): number {
  const [x, y] = [parseFloat(a.replace("−", "-")), parseFloat(b.replace("−", "-"))];
  if (Number.isNaN(x) !== Number.isNaN(y)) return Number.isNaN(x) ? 1 : -1;
  return Number.isNaN(x) ? a.localeCompare(b) : x - y;
}

export function words(part: Words): HTMLElement {
  const list = part.paragraphs.length > 1 && part.title
    ? el("ul", {}, ...part.paragraphs.map((p) => el("li", {}, p)))
    : el("div", {}, ...part.paragraphs.map((p) => el("p", {}, p)));
  return el("div", { class: "panel words" }, part.title && el("h3", {}, part.title), list);
}

export function code(part: Code): HTMLElement {
  const wrong = new Set(part.wrong);
  const lines = part.text.replace(/\n$/, "").split("\n").map((line, k) => {
    const n = part.first + k;
    const kind = part.diff
      ? line.startsWith("+") && !line.startsWith("+++") ? "added" : line.startsWith("-") && !line.startsWith("---") ? "removed" : line.startsWith("@@") || line.startsWith("---") || line.startsWith("+++") ? "place" : ""
      : wrong.has(n) ? "wrong" : "";
    return el("span", { class: `line ${kind}` }, !part.diff && el("i", {}, String(n)), line || " ");
  });
  return el("figure", { class: "panel" }, part.title && el("figcaption", {}, el("span", { class: "title" }, part.title)),
    el("pre", { class: part.diff ? "code diff" : "code", tabindex: 0 }, ...lines), part.note && el("p", { class: "note" }, part.note));
}

export function links(part: Links): HTMLElement {
  return el("div", { class: "panel" }, part.title && el("h3", {}, part.title),
    el("div", { class: "cards" }, ...part.entries.map(([href, title, note]) => el("a", { class: "card", href }, el("b", {}, title), el("span", {}, note)))));
}

const WEIGHTS = { cause: "Cause", doubt: "Doubt", note: "Note" };

export function finding(told: Told, go: (t: number | null, element: string) => void): HTMLElement {
  const { finding: f } = told;
  const where: (HTMLElement | false)[] = [
    told.t !== null && el("button", { type: "button", class: "jump", "data-t": told.t, click: () => go(told.t, told.element) }, `Show at ${Number(told.t.toPrecision(4))} s`),
    told.t === null && told.element !== "" && el("button", { type: "button", class: "jump", click: () => go(null, told.element) }, `Show ${told.element}`),
  ];
  return el("article", { class: `finding ${f.weight}` },
    el("header", {}, el("span", { class: "weight" }, WEIGHTS[f.weight]), el("code", {}, f.code), ...where),
    el("p", { class: "what" }, `${f.what}.`),
    f.evidence && el("p", { class: "evidence" }, f.evidence),
    f.remedy && el("p", { class: "remedy" }, el("b", {}, "What to do: "), `${f.remedy}.`));
}
