// Tables, words, source code, findings.

import type { Code, Grid, Told, Words } from "./data";
import { el, typeset } from "./dom";

export function grid(table: Grid): HTMLElement {
  const head = el("tr");
  const body = el("tbody");
  const rows = table.rows.map((cells, r) => {
    const row = el("tr", cells.length ? {} : { class: "rule" });
    if (!cells.length) row.append(el("td", { colspan: table.heads.length }));
    const link = table.links[r];
    cells.forEach((cell, k) => row.append(el("td", { class: table.numeric[k] ? "numeric" : undefined },
      link && k === cells.length - 1 ? el("a", { href: link }, cell) : typeset(cell))));
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
  if (table.folded) return el("details", { class: "panel wide" }, el("summary", {}, table.title), content);
  return el("div", { class: "panel wide" }, table.title && el("h3", {}, table.title), content);
}

function compared(a: string, b: string): number {
  const [x, y] = [parseFloat(a.replace("−", "-")), parseFloat(b.replace("−", "-"))];
  if (Number.isNaN(x) !== Number.isNaN(y)) return Number.isNaN(x) ? 1 : -1;
  return Number.isNaN(x) ? a.localeCompare(b) : x - y;
}

export function words(part: Words): HTMLElement {
  const list = part.paragraphs.length > 1 && part.title
    ? el("ul", {}, ...part.paragraphs.map((p) => el("li", {}, typeset(p))))
    : el("div", {}, ...part.paragraphs.map((p) => el("p", {}, typeset(p))));
  if (part.folded) return el("details", { class: "panel words wide" }, el("summary", {}, part.title), list);
  return el("div", { class: "panel words" }, part.title && el("h3", {}, part.title), list);
}

export function code(part: Code): HTMLElement {
  const wrong = new Set(part.wrong);
  const all = part.text.replace(/\n$/, "").split("\n");
  const lines = all.map((line, k) => {
    const n = part.first + k;
    const kind = part.diff
      ? line.startsWith("+") && !line.startsWith("+++") ? "added" : line.startsWith("-") && !line.startsWith("---") ? "removed" : line.startsWith("@@") || line.startsWith("---") || line.startsWith("+++") ? "place" : ""
      : wrong.has(n) ? "wrong" : "";
    return el("span", { class: `line ${kind}` }, !part.diff && el("i", {}, String(n)), ...(kind === "removed" || kind === "added" ? marked(all, k) : [line || " "]));
  });
  return el("figure", { class: "panel wide" }, part.title && el("figcaption", {}, el("span", { class: "title" }, part.title)),
    el("pre", { class: part.diff ? "code diff" : "code", tabindex: 0 }, ...lines), part.note && el("p", { class: "note" }, part.note));
}

/** A changed line with what differs from its counterpart marked. */
function marked(all: string[], k: number): (Node | string)[] {
  const line = all[k]!, sign = line[0]!, opposite = sign === "-" ? "+" : "-";
  let first = k;
  while (all[first - 1]?.[0] === sign) first -= 1;
  let last = k;
  while (all[last + 1]?.[0] === sign) last += 1;
  let other: string | undefined;
  if (sign === "-") other = all[last + 1 + (k - first)];
  else {
    let begin = first;
    while (all[begin - 1]?.[0] === opposite) begin -= 1;
    if (begin + (k - first) < first) other = all[begin + (k - first)];
  }
  if (other?.[0] !== opposite) return [line];
  let a = 1;
  while (a < line.length && a < other.length && line[a] === other[a]) a += 1;
  let b = 0;
  while (b < line.length - a && b < other.length - a && line[line.length - 1 - b] === other[other.length - 1 - b]) b += 1;
  return [line.slice(0, a), el("b", {}, line.slice(a, line.length - b)), line.slice(line.length - b)];
}

/** With a capital letter, unless the text begins with a name or a symbol. */
function sentence(text: string): string {
  return /^[a-z]+(?=[ ,:.]|$)/.test(text) ? text.charAt(0).toUpperCase() + text.slice(1) : text;
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
    el("p", { class: "what" }, typeset(`${sentence(f.what)}.`)),
    f.evidence && el("p", { class: "evidence" }, typeset(f.evidence)),
    f.remedy && el("p", { class: "remedy" }, el("b", {}, "What to do: "), typeset(`${f.remedy}.`)));
}
