// The one instant that all plots and the scene show, and the one window of time that all plots show.

type Listener = () => void;

export class Clock {
  t: number;
  window: [number, number];
  private moved = new Set<Listener>();
  private zoomed = new Set<Listener>();

  constructor(readonly start: number, readonly end: number) {
    this.t = start;
    this.window = [start, end];
  }

  set(t: number): void {
    const clamped = Math.min(this.end, Math.max(this.start, t));
    if (clamped === this.t) return;
    this.t = clamped;
    for (const listener of this.moved) listener();
  }

  zoom(from: number, to: number): void {
    const least = (this.end - this.start) * 1e-7;
    if (!(to - from > least)) return;
    this.window = [Math.max(this.start, from), Math.min(this.end, to)];
    for (const listener of this.zoomed) listener();
  }

  whole(): void {
    this.zoom(this.start, this.end);
  }

  onMove(listener: Listener): void {
    this.moved.add(listener);
  }

  onZoom(listener: Listener): void {
    this.zoomed.add(listener);
  }
}
