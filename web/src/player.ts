// The scene with its transport: play, scrub, speed, follow, what is shown.

import type { Clock } from "./clock";
import type { Scene } from "./data";
import { el, icon, number } from "./dom";
import { Stage } from "./scene";

const SPEEDS = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];

export class Player {
  readonly element: HTMLElement;
  stage: Stage | null = null;
  playing = false;
  private speed: number;
  private before = 0;
  private readonly button: HTMLButtonElement;
  private readonly scrub: HTMLInputElement;
  private readonly time: HTMLElement;
  private readonly canvas: HTMLCanvasElement;
  private readonly choose: HTMLSelectElement;

  constructor(private readonly scene: Scene, private readonly clock: Clock) {
    const duration = clock.end - clock.start;
    const wanted = duration > 25 ? duration / 15 : duration < 1.5 ? duration / 4 : 1;
    this.speed = SPEEDS.reduce((best, s) => (Math.abs(Math.log(s / wanted)) < Math.abs(Math.log(best / wanted)) ? s : best), 1);
    this.canvas = el("canvas", { class: "stage", tabindex: 0, role: "img", "aria-label": `The mechanism in motion: ${scene.bodies.slice(1, 12).map((b) => b.name).join(", ")}. Space plays, arrow keys step.` });
    const tip = el("div", { class: "tip", hidden: true });
    this.button = el("button", { type: "button", class: "play", "aria-label": "play", title: "Play or pause (space)", click: () => this.play(!this.playing) }, icon("play"));
    this.scrub = el("input", { type: "range", min: 0, max: 10000, value: 0, class: "scrub", "aria-label": "time", input: () => clock.set(clock.start + (Number(this.scrub.value) / 10000) * duration) });
    this.time = el("output", { class: "time" });
    this.choose = el("select", { class: "speed", "aria-label": "speed", title: "Speed", change: () => { this.speed = Number(this.choose.value); } },
      ...SPEEDS.map((s) => el("option", { value: s, selected: s === this.speed }, s < 1 ? `1/${Math.round(1 / s)}×` : `${s}×`)));
    const toggles = el("div", { class: "toggles", role: "group", "aria-label": "what is shown" });
    const names = scene.runs.map((r) => r.name).join(" and ");
    this.element = el("figure", { class: "panel scene" },
      el("figcaption", {}, el("span", { class: "title" }, "The motion"), el("span", { class: "runs" }, scene.runs.length > 1 ? (scene.side_by_side ? `left to right: ${scene.runs.map((r) => r.name).join(", ")}` : `${scene.runs[0]!.name}; pale: ${scene.runs[1]!.name}`) : names), ),
      el("div", { class: "view" }, this.canvas, toggles, tip),
      el("div", { class: "transport" }, this.button, this.scrub, this.time, this.choose));
    try {
      this.stage = new Stage(scene, clock, this.canvas);
    } catch {
      this.canvas.replaceWith(el("p", { class: "nothing" }, "This browser offers no WebGL, so the mechanism is not shown here; the plots are complete."));
    }
    const stage = this.stage;
    if (stage) {
      const { counts } = stage;
      const toggle = (name: string, title: string, on: boolean, act: (on: boolean) => void) => {
        const button = el("button", { type: "button", class: "tool", title, "aria-label": title, "aria-pressed": String(on), click: () => {
          const next = button.getAttribute("aria-pressed") !== "true";
          button.setAttribute("aria-pressed", String(next));
          act(next);
        } }, icon(name));
        toggles.append(button);
      };
      toggles.append(el("button", { type: "button", class: "tool", title: "The view of the start (R)", "aria-label": "reset the view", click: () => stage.home() }, icon("home")));
      toggle("follow", "Follow the mechanism (F)", stage.follow, (on) => { stage.follow = on; stage.home(); });
      if (counts.trails) toggle("trail", "Trails", true, (on) => stage.show("trails", on));
      if (counts.forces) toggle("force", "Forces", true, (on) => stage.show("forces", on));
      if (counts.joints) toggle("joints", "Joints", stage.jointsShown, (on) => stage.show("joints", on));
      if (counts.runs > 1 && !scene.side_by_side) toggle("ghost", `Also ${scene.runs[1]!.name}`, true, (on) => stage.show("runs", on));
      this.canvas.addEventListener("pointermove", (event) => {
        const name = event.buttons ? "" : stage.under(event.offsetX, event.offsetY);
        tip.hidden = !name;
        tip.textContent = name;
        tip.style.transform = `translate(${event.offsetX + 12}px, ${event.offsetY + 14}px)`;
      });
      this.canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
      new ResizeObserver(() => stage.resize()).observe(this.canvas);
    }
    clock.onMove(() => this.told());
    this.told();
  }

  play(on: boolean): void {
    if (on === this.playing) return;
    this.playing = on;
    this.button.replaceChildren(icon(on ? "pause" : "play"));
    this.button.setAttribute("aria-label", on ? "pause" : "play");
    if (!on) return;
    if (this.clock.t >= this.clock.end) this.clock.set(this.clock.start);
    this.before = performance.now();
    const step = (now: number) => {
      if (!this.playing) return;
      const t = this.clock.t + Math.min(0.1, (now - this.before) / 1000) * this.speed;
      this.before = now;
      this.clock.set(t >= this.clock.end ? (this.clock.t >= this.clock.end ? this.clock.start : this.clock.end) : t);
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  key(event: KeyboardEvent): boolean {
    const { clock } = this;
    const times = this.scene.runs[0]!.t;
    const step = ((clock.end - clock.start) / Math.max(1, times.length - 1)) * (event.shiftKey ? 20 : 1);
    switch (event.key) {
      case " ": this.play(!this.playing); return true;
      case "ArrowRight": this.play(false); clock.set(clock.t + step); return true;
      case "ArrowLeft": this.play(false); clock.set(clock.t - step); return true;
      case "Home": this.play(false); clock.set(clock.start); return true;
      case "End": this.play(false); clock.set(clock.end); return true;
      case "r": case "R": this.stage?.home(); return true;
      case "f": case "F": if (this.stage) { this.stage.follow = !this.stage.follow; this.stage.home(); } return true;
      case "[": case "]": {
        const k = SPEEDS.indexOf(this.speed) + (event.key === "]" ? 1 : -1);
        this.speed = SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, k))]!;
        this.choose.value = String(this.speed);
        return true;
      }
      default: return false;
    }
  }

  private told(): void {
    const { clock } = this;
    const share = (clock.t - clock.start) / (clock.end - clock.start || 1);
    this.scrub.value = String(Math.round(share * 10000));
    const text = `${number(clock.t, 4)} s`;
    this.scrub.setAttribute("aria-valuetext", text);
    this.time.textContent = text;
  }
}
