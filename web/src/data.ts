// The page's data: what `deltac.report.page.parts` writes, with its arrays unpacked.

export type Tone = "good" | "bad" | "doubt" | "plain";
export type Vec = [number, number, number];
export type Quat = [number, number, number, number];

export interface Line {
  name: string;
  y: Float32Array;
  high?: Float32Array;
  low?: Float32Array;
  dashed: boolean;
  shown: boolean;
  colour: number | string | null;
}
export interface Guide { name: string; value: number }
export interface TimePlot {
  kind: "time"; title: string; t: Float64Array; lines: Line[]; unit: string; log: boolean;
  guides: Guide[]; note: string; tall: boolean; rows: number; whole: boolean;
}
export interface Cloud {
  name: string; x: number[]; y: number[]; labels: string[]; joined: boolean;
  fit: [[number, number], [number, number]] | null; fit_name: string; mark: number | null; colour: number | string | null;
}
export interface LogPlot { kind: "points"; title: string; x: string; y: string; clouds: Cloud[]; guides: Guide[]; note: string }
export interface HeatMap {
  kind: "heat"; title: string; x: string; y: string; xs: number[]; ys: number[];
  values: (number | null)[][]; bad: boolean[][]; low: number; high: number; note: string;
}
export interface Bars { kind: "bars"; title: string; bars: [string, number, boolean][]; limit: number; note: string }
export interface Flow { name: string; energy: number; error: number; group: "flow" | "store" | "left"; colour: number | string }
export interface Flows { kind: "flows"; title: string; flows: Flow[]; note: string }
export interface Grid { kind: "table"; title: string; heads: string[]; rows: string[][]; numeric: boolean[]; folded: boolean; links: string[] }
export interface Words { kind: "words"; title: string; paragraphs: string[]; folded: boolean }
export interface Code { kind: "code"; title: string; text: string; first: number; wrong: number[]; diff: boolean; note: string }
export type Part = TimePlot | LogPlot | HeatMap | Bars | Flows | Grid | Words | Code;

export interface Finding {
  code: string; kind: string; what: string; evidence: string; remedy: string; weight: "cause" | "doubt" | "note"; element: string;
}
export interface Told { finding: Finding; t: number | null; element: string }
export interface Chapter { heading: string; parts: Part[]; findings: Told[]; lead: string }

export interface Form {
  kind: "sphere" | "box" | "capsule" | "cylinder" | "ellipsoid" | "mesh" | "plane";
  size: number[]; position: Vec; rotation: Quat; colour: [number, number, number, number] | null;
  vertices: Float32Array | null; faces: number[] | null;
}
export interface Joint { name: string; kind: string; parent: string; position: Vec; axis: Vec | null }
export interface Body { name: string; forms: Form[]; carried: Joint | null; inferred: boolean; tip: Vec }
export interface Arrow { name: string; kind: "contact" | "constraint" | "applied"; at: Float32Array; force: Float32Array }
export interface Moving { name: string; t: Float64Array; poses: Float32Array; forces: Arrow[] }
export interface Tie { kind: "spring" | "tendon" | "rod" | "loop"; name: string; points: [number, Vec][] }
export interface Scene {
  bodies: Body[]; runs: Moving[]; ties: Tie[]; trails: [number, Vec][]; up: Vec; view: Vec; centre: Vec;
  half: Vec; radius: number; size: number; floor: number | null; follow: boolean; side_by_side: boolean;
}
export interface Page {
  title: string; asked: string; tone: Tone; word: string; sentence: string; numbers: [string, string][];
  chapters: Chapter[]; scene: Scene | null; limits: string[]; made: [string, string][]; data: unknown;
}

function bytes(text: string): ArrayBuffer {
  const raw = atob(text);
  const out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out.buffer;
}

/** Arrays packed as {"f4": base64} or {"f8": base64} become typed arrays. */
function unpacked(_: string, value: unknown): unknown {
  if (value && typeof value === "object") {
    const { f4, f8 } = value as { f4?: unknown; f8?: unknown };
    if (typeof f4 === "string") return new Float32Array(bytes(f4));
    if (typeof f8 === "string") return new Float64Array(bytes(f8));
  }
  return value;
}

export function read(): Page {
  return JSON.parse(document.getElementById("data")!.textContent!, unpacked) as Page;
}
