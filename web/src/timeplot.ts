// Curves over time: uPlot, with a legend of buttons that show the values at the page's instant.

import uPlot from "uplot";
import type { Clock } from "./clock";
import type { Line, TimePlot } from "./data";
import { colour, el, icon, number, power, save, variable } from "./dom";

interface Drawn { line: Line; series: number; low: number; high: number; value: HTMLElement; button: HTMLElement; shown: boolean }

export class Plot {
  readonly element: HTMLElement;
  private u: uPlot | null = null;
  private readonly place: HTMLElement;
  private readonly now: HTMLElement;
  private readonly drawn: Drawn[] = [];
  private readonly data: uPlot.AlignedData;

  constructor(private readonly plot: TimePlot, private readonly clock: Clock) {
    this.place = el("div", { class: "canvas" });
    this.now = el("div", { class: "now", "aria-hidden": "true" });
    const legend = el("div", { class: "legend", role: "group", "aria-label": "curves" });
    const hidden = plot.lines.filter((line) => !line.shown).length;
    if (hidden > 4) legend.classList.add("short");
    const columns: ArrayLike<number | null>[] = [plot.t];
    let n = 1;
    plot.lines.forEach((line, k) => {
      const value = el("span", { class: "value" });
      const button = el("button", {
        type: "button", class: "key", "aria-pressed": String(line.shown),
        style: `--c: var(--${variable(line.colour, k)})`,
        click: () => this.toggle(entry),
      }, el("i", { class: line.dashed ? "swatch dashed" : "swatch" }), el("span", {}, line.name), value);
      const entry: Drawn = { line, series: n, low: 0, high: 0, value, button, shown: line.shown };
      columns.push(gaps(line.y));
      n += 1;
      if (line.high) {
        columns.push(gaps(line.high));
        columns.push(line.low ? gaps(line.low) : new Float64Array(line.high.length).fill(1e-300));
        entry.high = n;
        entry.low = n + 1;
        n += 2;
      }
      this.drawn.push(entry);
      if (!line.shown) button.classList.add("extra");
      legend.append(button);
    });
    if (hidden > 4) legend.append(el("button", { type: "button", class: "key more", click: () => legend.classList.remove("short") }, `${hidden} more`));
    this.data = columns as uPlot.AlignedData;
    const tools = el("div", { class: "tools" },
      el("button", { type: "button", class: "tool", title: "Show all of the time", "aria-label": "show all of the time", click: () => clock.whole() }, icon("zoom")),
      el("button", { type: "button", class: "tool", title: "Download these curves as CSV", "aria-label": `download ${plot.title} as CSV`, click: () => this.csv() }, icon("down"), "CSV"));
    const cut = plot.whole ? "" : `${plot.rows.toLocaleString("en")} rows, drawn from the smallest to the largest value of each of ${(plot.t.length / 2).toLocaleString("en")} stretches: no peak is lost.`;
    const note = [plot.note, plot.tall ? cut : ""].filter(Boolean).join(" ");
    this.element = el("figure", { class: "panel", role: "group", "aria-label": plot.title },
      el("figcaption", {}, el("span", { class: "title", title: cut || undefined }, plot.title), tools),
      this.place, legend, note && el("p", { class: "note" }, note));
    new ResizeObserver(() => this.resize()).observe(this.place);
    clock.onMove(() => this.move());
    clock.onZoom(() => this.u?.setScale("x", { min: this.window[0], max: this.window[1] }));
  }

  /** What it shows of the time: of a page whose runs last differently, all of its own. */
  private get window(): [number, number] {
    const { t } = this.plot, { start, end, window } = this.clock;
    return window[0] === start && window[1] === end && t.length > 1 ? [t[0]!, t[t.length - 1]!] : window;
  }

  /** Draw it anew, as for other colours. */
  draw(): void {
    this.u?.destroy();
    const { plot } = this;
    const series: uPlot.Series[] = [{}];
    const bands: uPlot.Band[] = [];
    this.drawn.forEach(({ line, high, low, shown }, k) => {
      const stroke = colour(variable(line.colour, k));
      series.push({ show: shown, stroke, width: line.dashed ? 1.2 : 1.6, dash: line.dashed ? [5, 4] : undefined, points: { show: false }, spanGaps: false });
      if (high) {
        const hidden: uPlot.Series = { show: shown, stroke: "transparent", width: 0, points: { show: false } };
        series.push(hidden, { ...hidden });
        bands.push({ series: [high, low], fill: stroke + "2b" });
      }
    });
    const axis = { stroke: colour("soft"), grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("grid"), width: 1, size: 4 }, font: "12px system-ui, sans-serif" };
    this.u = new uPlot({
      width: this.place.clientWidth || 600,
      height: this.height(),
      legend: { show: false },
      scales: {
        x: { time: false, min: this.window[0], max: this.window[1] },
        y: { distr: plot.log ? 3 : 1, range: (u) => this.range(u) },
      },
      axes: [
        { ...axis, size: 34, values: (_, ticks) => ticks.map((v) => number(v, 7)) },
        {
          ...axis, size: 62,
          ...(plot.log ? { splits: (u: uPlot) => powers(u.scales.y!.min!, u.scales.y!.max!), filter: (_: uPlot, at: number[]) => at } : {}),
          values: (_, ticks) => plot.log ? ticks.map((v) => power(Math.round(Math.log10(v)))) : ticks.map((v) => number(v, 5)),
        },
      ],
      cursor: {
        sync: { key: "t", scales: ["x", null] },
        drag: { x: true, y: false, setScale: false },
        points: { size: 5 },
        y: false,
      },
      series,
      bands,
      hooks: {
        draw: [(u) => this.guides(u)],
        setCursor: [(u) => this.hover(u)],
        setSelect: [(u) => {
          if (u.select.width > 6) this.clock.zoom(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        }],
        setScale: [(_, key) => key === "x" && this.move()],
        ready: [(u) => u.over.addEventListener("dblclick", () => this.clock.whole())],
      },
    }, this.data, this.place);
    this.place.setAttribute("role", "img");
    this.place.setAttribute("aria-label", this.described());
    this.u.over.append(this.now);
    this.u.over.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.u.root.append(el("div", { class: "unit" }, plot.unit));
    this.move();
  }

  resize(): void {
    if (this.u && this.place.clientWidth && this.u.width !== this.place.clientWidth) this.u.setSize({ width: this.place.clientWidth, height: this.height() });
  }

  get ready(): boolean {
    return this.u !== null;
  }

  private height(): number {
    return this.plot.tall ? Math.max(240, Math.min(400, window.innerHeight * 0.44)) : 220;
  }

  private described(): string {
    const told = this.plot.lines.slice(0, 8).map((line) => {
      let low = Infinity, high = -Infinity;
      for (const v of line.y) if (Number.isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); }
      return `${line.name} from ${number(low)} to ${number(high)} ${this.plot.unit}`;
    });
    return `${this.plot.title}; ${told.join("; ")}`;
  }

  private range(u: uPlot): [number, number] {
    const { log, guides } = this.plot;
    const [from, to] = u.series[0]!.idxs ?? [0, this.plot.t.length - 1];
    let low = Infinity, high = -Infinity, bars = Infinity;
    const look = (values: ArrayLike<number | null>, bar = false) => {
      const seen: number[] = [];
      for (let i = from; i <= to; i++) {
        const v = values[i];
        if (v !== null && v !== undefined && Number.isFinite(v) && (!log || v > 0)) seen.push(v);
      }
      // ΔC begins at zero: a log axis need not reach down to a curve's few smallest values.
      const least = log ? seen.sort((a, b) => a - b)[Math.floor(0.02 * seen.length)] : seen.reduce((a, b) => Math.min(a, b), Infinity);
      if (bar && log) bars = Math.min(bars, least ?? Infinity);
      else low = Math.min(low, least ?? Infinity);
      high = seen.reduce((a, b) => Math.max(a, b), high);
    };
    for (const entry of this.drawn) {
      if (!entry.shown) continue;
      look(this.data[entry.series] as ArrayLike<number>);
      if (entry.high) look(this.data[entry.high] as ArrayLike<number>, true);
      if (entry.low && entry.line.low) look(this.data[entry.low] as ArrayLike<number>);
    }
    for (const { value } of guides) if (!log || value > 0) { low = Math.min(low, value); high = Math.max(high, value); }
    // Nor far down to bars, which say no more than that they are small.
    low = Math.min(low, Math.max(bars, 1e-3 * low));
    if (!(low <= high)) return log ? [1e-3, 1] : [0, 1];
    if (log) {
      const a = Math.floor(Math.log10(low) - 0.15), b = Math.ceil(Math.log10(high) + 0.15);
      return [10 ** a, 10 ** Math.max(b, a + 1)];
    }
    const room = high > low ? 0.06 * (high - low) : Math.abs(high) * 0.1 || 1;
    return [low - room, high + room];
  }

  private guides(u: uPlot): void {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
    this.plot.guides.forEach(({ name, value }) => {
      const y = Math.round(u.valToPos(value, "y", true)) + 0.5;
      ctx.strokeStyle = ctx.fillStyle = colour(name === "accepted" ? "good" : "soft");
      ctx.lineWidth = devicePixelRatio;
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      ctx.textAlign = "right";
      ctx.textBaseline = "bottom";
      ctx.setLineDash([]);
      ctx.lineWidth = 3 * devicePixelRatio;
      ctx.strokeStyle = colour("card");
      ctx.lineJoin = "round";
      const said = `${name} ${number(value, 3)} ${this.plot.unit}`;
      const x = bbox.left + bbox.width - 6 * devicePixelRatio;
      ctx.strokeText(said, x, y - 2 * devicePixelRatio);
      ctx.fillText(said, x, y - 2 * devicePixelRatio);
      ctx.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
    });
    ctx.restore();
  }

  private hover(u: uPlot): void {
    const left = u.cursor.left ?? -1;
    if (left >= 0 && u.over.matches(":hover") && u.select.width === 0) this.clock.set(u.posToVal(left, "x"));
  }

  private wheel(event: WheelEvent): void {
    if (!(event.ctrlKey || event.shiftKey) || !this.u) return;
    event.preventDefault();
    const at = this.u.posToVal(event.offsetX, "x");
    const factor = Math.exp((event.deltaY || event.deltaX) * 0.002);
    const [a, b] = this.window;
    this.clock.zoom(at - (at - a) * factor, at + (b - at) * factor);
  }

  private move(): void {
    if (!this.u) return;
    const x = this.u.valToPos(this.clock.t, "x");
    const inside = x >= -1 && x <= this.u.over.clientWidth + 1;
    this.now.style.display = inside ? "" : "none";
    this.now.style.transform = `translateX(${x}px)`;
    const i = nearest(this.plot.t, this.clock.t);
    for (const { line, value, shown } of this.drawn) value.textContent = shown ? `${number(line.y[i])} ${this.plot.unit}`.trim() : "";
  }

  private toggle(entry: Drawn): void {
    entry.shown = !entry.shown;
    entry.button.setAttribute("aria-pressed", String(entry.shown));
    for (const s of [entry.series, entry.high, entry.low]) if (s) this.u?.setSeries(s, { show: entry.shown });
    this.move();
  }

  private csv(): void {
    const { t, lines, unit, title } = this.plot;
    const quoted = (name: string) => `"${name.replaceAll('"', '""')}"`;
    const rows = [["time (s)", ...lines.map((l) => (unit ? `${l.name} (${unit})` : l.name))].map(quoted).join(",")];
    for (let i = 0; i < t.length; i++) rows.push([t[i], ...lines.map((l) => (Number.isFinite(l.y[i]!) ? l.y[i] : ""))].join(","));
    save(rows.join("\n") + "\n", `${title.replace(/[^\p{L}\p{N}]+/gu, "_")}.csv`, "text/csv");
  }
}

/** The powers of ten within a range, at most nine of them. */
function powers(low: number, high: number): number[] {
  const a = Math.ceil(Math.log10(low) - 1e-9), b = Math.floor(Math.log10(high) + 1e-9);
  const every = Math.max(1, Math.ceil((b - a + 1) / 9));
  const found = [];
  for (let k = a; k <= b; k++) if (k % every === 0) found.push(10 ** k);
  return found;
}

/** uPlot leaves a gap at null, not at NaN. */
function gaps(values: Float32Array): ArrayLike<number | null> {
  return values.every(Number.isFinite) ? values : Array.from(values, (v) => (Number.isFinite(v) ? v : null));
}

export function nearest(t: Float64Array, at: number): number {
  let a = 0, b = t.length - 1;
  while (b - a > 1) {
    const k = (a + b) >> 1;
    if (t[k]! <= at) a = k;
    else b = k;
  }
  return at - t[a]! <= t[b]! - at ? a : b;
}
