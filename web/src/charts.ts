// Drawings that need no time: points on log axes, and where the energy went. SVG in the page's own colours.

import type { Bars, Cloud, Flows, HeatMap, LogPlot } from "./data";
import { el, fraction, number, power, svg, variable } from "./dom";

const W = innerWidth < 560 ? 350 : 560, H = 330, LEFT = 62, RIGHT = 18, TOP = 14, BOTTOM = 46;

function span(values: number[], room: number): [number, number] {
  const logs = values.filter((v) => v > 0 && Number.isFinite(v)).map(Math.log10);
  if (!logs.length) return [-1, 0];
  const low = Math.min(...logs), high = Math.max(...logs);
  const extra = Math.max(room * (high - low), 0.15);
  return [low - extra, high + extra];
}

function ticks([low, high]: [number, number]): [number, string][] {
  const found: [number, string][] = [];
  const every = Math.max(1, Math.ceil((high - low) / 7));
  for (let k = Math.ceil(low); k <= high; k++) if (k % every === 0) found.push([k, power(k)]);
  if (found.length >= 2) return found;
  const fine: [number, string][] = [];
  for (let k = Math.floor(low); k <= high; k++) {
    for (const m of [1, 2, 5]) {
      const at = k + Math.log10(m);
      if (at >= low && at <= high) fine.push([at, number(m * 10 ** k, 2)]);
    }
  }
  return fine;
}

export function logPlot(plot: LogPlot): HTMLElement {
  const fits = plot.clouds.flatMap((c) => c.fit ?? []);
  const xs = span([...plot.clouds.flatMap((c) => c.x), ...fits.map((p) => p[0])], 0.1);
  const ys = span([...plot.clouds.flatMap((c) => c.y), ...plot.guides.map((g) => g.value), ...fits.map((p) => p[1])], 0.1);
  const X = (v: number) => LEFT + ((Math.log10(v) - xs[0]) / (xs[1] - xs[0])) * (W - LEFT - RIGHT);
  const Y = (v: number) => H - BOTTOM - ((Math.log10(v) - ys[0]) / (ys[1] - ys[0])) * (H - TOP - BOTTOM);
  const root = svg("svg", { viewBox: `0 0 ${W} ${H}`, class: "chart", role: "img", "aria-label": `${plot.title}; ${plot.clouds.map(told).join("; ")}` });
  for (const [at, text] of ticks(xs)) {
    const x = X(10 ** at);
    root.append(svg("line", { x1: x, x2: x, y1: TOP, y2: H - BOTTOM, class: "gridline" }), svg("text", { x, y: H - BOTTOM + 17, class: "tick", "text-anchor": "middle" }, text));
  }
  for (const [at, text] of ticks(ys)) {
    const y = Y(10 ** at);
    root.append(svg("line", { x1: LEFT, x2: W - RIGHT, y1: y, y2: y, class: "gridline" }), svg("text", { x: LEFT - 7, y: y + 4, class: "tick", "text-anchor": "end" }, text));
  }
  root.append(
    svg("text", { x: (LEFT + W - RIGHT) / 2, y: H - 8, class: "axis", "text-anchor": "middle" }, plot.x),
    svg("text", { x: -(TOP + H - BOTTOM) / 2, y: 13, class: "axis", "text-anchor": "middle", transform: "rotate(-90)" }, plot.y));
  for (const { name, value } of plot.guides) {
    root.append(
      svg("line", { x1: LEFT, x2: W - RIGHT, y1: Y(value), y2: Y(value), class: "guide" }),
      svg("text", { x: W - RIGHT - 4, y: Y(value) - 5, class: "guidename", "text-anchor": "end" }, `${name} ${number(value, 3)}`));
  }
  const legend = el("div", { class: "legend" });
  plot.clouds.forEach((cloud, k) => {
    const stroke = `var(--${variable(cloud.colour, k)})`;
    if (cloud.fit) {
      const [[x1, y1], [x2, y2]] = cloud.fit;
      root.append(svg("line", { x1: X(x1), y1: Y(y1), x2: X(x2), y2: Y(y2), style: `stroke:${stroke}`, class: "fit" }));
    }
    const places = cloud.x.map((x, i) => [X(x), Y(cloud.y[i]!)] as const).filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y));
    if (cloud.joined && places.length > 1) root.append(svg("polyline", { points: places.map((p) => p.join(",")).join(" "), style: `stroke:${stroke}`, class: "joined" }));
    places.forEach(([x, y], i) => {
      const chosen = cloud.mark === i;
      if (chosen) root.append(svg("circle", { cx: x, cy: y, r: 11, style: `stroke:${stroke}`, class: "chosen" }));
      root.append(svg("circle", { cx: x, cy: y, r: 4.2, style: `fill:${stroke}` }, svg("title", {}, `${cloud.labels[i] ?? cloud.name}: ${number(cloud.x[i])}, ${number(cloud.y[i])}`)));
    });
    legend.append(el("span", { class: "key still", style: `--c:${stroke}` }, el("i", { class: "dot" }), cloud.name, cloud.fit_name && el("span", { class: "value" }, cloud.fit_name)));
  });
  return el("figure", { class: "panel" }, el("figcaption", {}, el("span", { class: "title" }, plot.title)), root as unknown as HTMLElement, legend, plot.note && el("p", { class: "note" }, plot.note));
}

/** Sizes over two axes: one hue, the darker the larger, on the log scale that all maps of the page share. */
export function heatMap(map: HeatMap): HTMLElement {
  const nx = map.xs.length, ny = map.ys.length, left = 58, top = 8, bottom = 44;
  const cw = (W - left - 12) / nx, ch = Math.max(12, Math.min(46, 260 / ny)), height = top + ny * ch + bottom;
  const a = Math.log10(map.low), b = Math.log10(map.high);
  const weight = (v: number) => 8 + 84 * (b > a ? (Math.log10(v) - a) / (b - a) : 0.5);
  const fill = (v: number) => `color-mix(in oklab, var(--ink) ${weight(v).toFixed(1)}%, var(--card))`;
  const root = svg("svg", { viewBox: `0 0 ${W} ${height}`, class: "chart", role: "img", "aria-label": `${map.title}: ${map.y} over ${map.x}` });
  map.values.forEach((row, j) => row.forEach((v, i) => {
    const x = left + i * cw, y = top + (ny - 1 - j) * ch;
    const cell = svg("rect", { x, y, width: cw, height: ch, class: "cell", style: v === null ? "fill:none" : `fill:${fill(v)}` },
      svg("title", {}, `${map.x} = ${number(map.xs[i])}, ${map.y} = ${number(map.ys[j])}: ${number(v, 3)}`));
    root.append(cell);
    if (map.bad[j]![i]) root.append(svg("text", { x: x + cw / 2, y: y + ch / 2 + 4, class: "cross", "text-anchor": "middle" }, "×"));
  }));
  const some = (n: number, room: number) => [...Array(n).keys()].filter((k) => k % Math.ceil(n / room) === 0);
  for (const i of some(nx, W < 500 ? 5 : 8)) root.append(svg("text", { x: left + (i + 0.5) * cw, y: top + ny * ch + 16, class: "tick", "text-anchor": "middle" }, number(map.xs[i], 3)));
  for (const j of some(ny, Math.max(2, Math.floor((ny * ch) / 16)))) root.append(svg("text", { x: left - 6, y: top + (ny - 0.5 - j) * ch + 4, class: "tick", "text-anchor": "end" }, number(map.ys[j], 3)));
  root.append(
    svg("text", { x: (left + W - 12) / 2, y: height - 8, class: "axis", "text-anchor": "middle" }, map.x),
    svg("text", { x: -(top + (ny * ch) / 2), y: 12, class: "axis", "text-anchor": "middle", transform: "rotate(-90)" }, map.y));
  const scale = el("div", { class: "scale" }, el("span", {}, number(map.low, 2)),
    el("i", { style: `background:linear-gradient(to right in oklab, ${fill(map.low)}, ${fill(map.high)})` }), el("span", {}, number(map.high, 2)));
  return el("figure", { class: "panel" }, el("figcaption", {}, el("span", { class: "title" }, map.title)), root as unknown as HTMLElement, scale, map.note && el("p", { class: "note" }, map.note));
}

function told(cloud: Cloud): string {
  const n = cloud.x.length;
  return n ? `${cloud.name}: ${number(cloud.y[0])} at ${number(cloud.x[0])}, ${number(cloud.y[n - 1])} at ${number(cloud.x[n - 1])}${cloud.fit_name ? `, ${cloud.fit_name}` : ""}` : cloud.name;
}

/** A waterfall: works flow in and out, what is stored of them, and what is left. */
export function flows(plot: Flows): HTMLElement {
  let level = 0;
  const rows: { name: string; from: number; to: number; energy: number; error: number; group: string; colour: number | string }[] = [];
  for (const f of plot.flows.filter((f) => f.group === "flow")) {
    rows.push({ ...f, from: level, to: level + f.energy });
    level += f.energy;
  }
  const flowing = rows.length;
  const received = level;
  level = 0;
  for (const f of plot.flows.filter((f) => f.group === "store")) {
    rows.push({ ...f, from: level, to: level + f.energy });
    level += f.energy;
  }
  for (const f of plot.flows.filter((f) => f.group === "left")) rows.push({ ...f, from: level - f.energy, to: level });
  const ends = rows.flatMap((r) => [r.from, r.to, 0]);
  const low = Math.min(...ends), high = Math.max(...ends);
  const width = high - low || 1;
  const at = (v: number) => ((v - low) / width) * 100;
  const body = el("div", { class: "flows", role: "table", "aria-label": plot.title });
  rows.forEach((r, k) => {
    const [a, b] = [Math.min(r.from, r.to), Math.max(r.from, r.to)];
    const bar = el("span", { class: "bar", style: `left:${at(a)}%;width:max(2px, ${at(b) - at(a)}%);background:var(--${variable(r.colour)})` });
    const zero = el("span", { class: "zero", style: `left:${at(0)}%` });
    const error = r.error > 0 ? ` ± ${number(r.error, 2)}` : "";
    if (k === flowing && flowing) body.append(el("div", { class: "flow sum", role: "row" }, el("span", { role: "cell" }, "received altogether"), el("span", { class: "track" }, el("span", { class: "mark", style: `left:${at(received)}%` })), el("span", { role: "cell", class: "amount" }, `${number(received)} J`)));
    body.append(el("div", { class: `flow ${r.group}`, role: "row" }, el("span", { role: "cell", class: "name", title: r.name }, r.name), el("span", { class: "track" }, zero, bar), el("span", { role: "cell", class: "amount" }, `${r.energy > 0 ? "+" : ""}${number(r.energy)}${error} J`)));
  });
  return el("figure", { class: "panel" }, el("figcaption", {}, el("span", { class: "title" }, plot.title)), body, plot.note && el("p", { class: "note" }, plot.note));
}

/** Sizes on a log axis, with what is accepted as a line across. */
export function bars(plot: Bars): HTMLElement {
  const sizes = plot.bars.map((b) => b[1]).filter((v) => v > 0);
  const low = Math.floor(Math.log10(Math.min(plot.limit, ...sizes)) - 0.5), high = Math.ceil(Math.log10(Math.max(plot.limit, ...sizes)) + 0.2);
  const at = (v: number) => Math.max(0, ((Math.log10(v) - low) / (high - low)) * 100);
  const body = el("div", { class: "flows", role: "table", "aria-label": plot.title });
  for (const [name, size, wrong] of plot.bars) {
    body.append(el("div", { class: "flow", role: "row" }, el("span", { role: "cell", class: "name" }, name),
      el("span", { class: "track" }, el("span", { class: "accepted", style: `left:${at(plot.limit)}%` }), size > 0 && el("span", { class: `bar ${wrong ? "wrong" : size > plot.limit ? "beyond" : "right"}`, style: `left:0;width:${Math.max(0.5, at(size))}%` })),
      el("span", { role: "cell", class: "amount" }, fraction(size), wrong ? " fails" : size > plot.limit ? " rough" : "")));
  }
  return el("figure", { class: "panel" }, el("figcaption", {}, el("span", { class: "title" }, plot.title)), body,
    el("p", { class: "note" }, `Log axis from ${power(low)} to ${power(high)}; the line marks ${fraction(plot.limit)}, which is accepted. ${plot.note}`));
}
