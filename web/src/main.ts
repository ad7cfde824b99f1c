// The page: banner, evidence beside the moving mechanism, chapters, provenance.

import "uplot/dist/uPlot.min.css";
import "./page.css";
import { bars, flows, heatMap, logPlot } from "./charts";
import { Clock } from "./clock";
import { read, type Page, type Part } from "./data";
import { el, icon, save, typeset } from "./dom";
import { Player } from "./player";
import { code, finding, grid, words } from "./texts";
import { Plot } from "./timeplot";

const page: Page = read();
const root = document.documentElement;
const plots: Plot[] = [];
root.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";

function times(): [number, number] {
  let start = Infinity, end = -Infinity;
  const look = (t: Float64Array) => { if (t.length) { start = Math.min(start, t[0]!); end = Math.max(end, t[t.length - 1]!); } };
  for (const run of page.scene?.runs ?? []) look(run.t);
  if (!(start < end)) for (const chapter of page.chapters) for (const part of chapter.parts) if (part.kind === "time") look(part.t);
  return start < end ? [start, end] : [0, 1];
}

const clock = new Clock(...times());
const player = page.scene ? new Player(page.scene, clock) : null;

function draw(part: Part): HTMLElement {
  switch (part.kind) {
    case "time": {
      const plot = new Plot(part, clock);
      plots.push(plot);
      return plot.element;
    }
    case "points": return logPlot(part);
    case "heat": return heatMap(part);
    case "bars": return bars(part);
    case "flows": return flows(part);
    case "table": return grid(part);
    case "words": return words(part);
    case "code": return code(part);
  }
}

const ICON = { good: "✓", bad: "✕", doubt: "?", plain: "i" }[page.tone];

function banner(): HTMLElement {
  const theme = el("button", { type: "button", class: "tool", title: "Light or dark", "aria-label": "light or dark", click: () => {
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    retheme();
  } }, icon("theme"));
  return el("header", { class: `banner ${page.tone}` },
    el("div", { class: "top" }, el("span", { class: "brand" }, "ΔC"), el("span", { class: "subject" }, page.title), theme),
    el("p", { class: "asked" }, page.asked),
    el("div", { class: "verdict", role: "status" }, el("span", { class: "mark", "aria-hidden": "true" }, ICON),
      el("div", {}, el("h1", {}, typeset(page.word)), page.sentence && el("p", { class: "sentence" }, typeset(page.sentence)))),
    page.numbers.length > 0 && el("dl", { class: "numbers" }, ...page.numbers.map(([what, value]) => el("div", {}, el("dt", {}, what), el("dd", {}, typeset(value))))));
}

function go(t: number | null, element: string): void {
  player?.play(false);
  if (t !== null) {
    const [a, b] = clock.window;
    if (t < a || t > b) clock.whole();
    clock.set(t);
  }
  if (element) player?.stage?.point(element);
  (player?.element ?? plots[0]?.element)?.scrollIntoView({ behavior: "smooth", block: "center" });
}

function build(): void {
  const main = el("main", { id: "page" });
  main.append(banner());
  page.chapters.forEach((chapter, k) => {
    const parts = chapter.parts.map(draw);
    const beside = k === 0 && player !== null;
    if (!parts.length && !chapter.findings.length && !beside) return;
    const section = el("section", {}, el("h2", {}, chapter.heading), chapter.lead && el("p", { class: "lead" }, typeset(chapter.lead)));
    if (beside) {
      const [first, ...rest] = parts;
      section.append(el("div", { class: first ? "proof" : "proof alone" }, first ?? null, player!.element), el("div", { class: "grid" }, ...rest));
    } else if (parts.length) section.append(el("div", { class: "grid" }, ...parts));
    if (chapter.findings.length) section.append(el("div", { class: "findings" }, ...chapter.findings.map((told) => finding(told, go))));
    main.append(section);
  });
  if (page.limits.length) main.append(el("section", {}, el("h2", {}, "What this test cannot see"), el("ul", { class: "limits" }, ...page.limits.map((l) => el("li", {}, typeset(l))))));
  main.append(el("section", {}, el("h2", {}, "How to reproduce it"),
    el("dl", { class: "made" }, ...page.made.map(([what, value]) => el("div", {}, el("dt", {}, what), el("dd", {}, what === "command" ? el("code", {}, value) : typeset(value))))),
    el("p", { class: "tools" }, el("button", { type: "button", class: "tool", click: () => save(JSON.stringify(page.data, null, 2), "report.json", "application/json") }, icon("down"), "The report as JSON"))));
  main.append(el("footer", {}, "Made by deltac. The page holds all of its data and loads nothing from elsewhere. It contains three.js and uPlot (MIT licence). ",
    player && "Keys: space plays, ← → step, Home and End, [ ] speed, F follows, R resets the view. ", plots.length > 0 && "Drag across a plot to zoom, double-click for all of the time."));
  document.getElementById("page")!.replaceWith(main);
}

function retheme(): void {
  for (const plot of plots) if (plot.ready) plot.draw();
  player?.stage?.theme();
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (event) => {
  root.dataset.theme = event.matches ? "dark" : "light";
  retheme();
});
build();

const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    if (!entry.isIntersecting) continue;
    const plot = plots.find((p) => p.element === entry.target);
    if (plot && !plot.ready) plot.draw();
    seen.unobserve(entry.target);
  }
}, { rootMargin: "600px" });
for (const plot of plots) seen.observe(plot.element);

addEventListener("beforeprint", () => {
  player?.play(false);
  root.dataset.theme = "light";
  for (const plot of plots) plot.draw();
  player?.stage?.theme();
});
addEventListener("keydown", (event) => {
  const inside = event.target as HTMLElement;
  if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT)$/.test(inside.tagName)) return;
  if (/^(BUTTON|SUMMARY|A)$/.test(inside.tagName) && /^( |Enter)$/.test(event.key)) return;
  if (inside.closest?.(".scroll, pre") && event.key.startsWith("Arrow")) return;
  if (player?.key(event)) event.preventDefault();
});

if (player?.stage && !matchMedia("(prefers-reduced-motion: reduce)").matches && !location.hash.includes("still")) player.play(true);

Object.assign(window, { deltac: { page, clock, player, plots } });
