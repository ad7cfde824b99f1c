// Elements of the page; all text goes in as text, never as markup.

type Child = Node | string | null | undefined | false;
type Attributes = Record<string, string | number | boolean | ((event: Event) => void) | undefined>;

function put<E extends Element>(element: E, attributes: Attributes, children: Child[]): E {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === false) continue;
    if (typeof value === "function") element.addEventListener(name, value);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  for (const child of children) if (child || child === "") element.append(child as Node | string);
  return element;
}

export function el<K extends keyof HTMLElementTagNameMap>(
  tag: K, attributes: Attributes = {}, ...children: Child[]
): HTMLElementTagNameMap[K] {
  return put(document.createElement(tag), attributes, children);
}

export function svg<K extends keyof SVGElementTagNameMap>(
  tag: K, attributes: Attributes = {}, ...children: Child[]
): SVGElementTagNameMap[K] {
  return put(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

const ICONS: Record<string, string> = {
  play: "M6 4l13 8-13 8z",
  pause: "M6 4h4v16H6zM14 4h4v16h-4z",
  home: "M12 3l9 8h-3v9h-5v-6h-2v6H6v-9H3z",
  follow: "M12 8a4 4 0 100 8 4 4 0 000-8zM11 1h2v5h-2zM11 18h2v5h-2zM1 11h5v2H1zM18 11h5v2h-5z",
  trail: "M3 19c5 0 4-13 10-13 3 0 4 3 8 3v2c-5 0-5-3-8-3-4 0-3 13-10 13z",
  force: "M11 21V8H6l6-6 6 6h-5v13z",
  joints: "M12 3a4 4 0 013 6.6V14.4A4 4 0 1112 21a4 4 0 01-1-7.9V9.9A4 4 0 0112 3z",
  ghost: "M5 21V10a7 7 0 0114 0v11l-3.5-2.5L12 21l-3.5-2.5z",
  down: "M11 3h2v9h4l-5 6-5-6h4zM4 19h16v2H4z",
  theme: "M12 3a9 9 0 109 9 7 7 0 01-9-9z",
  zoom: "M4 4h7v2H6v5H4zM20 20h-7v-2h5v-5h2z",
};

export function icon(name: string): SVGElement {
  return svg("svg", { viewBox: "0 0 24 24", width: 16, height: 16, "aria-hidden": "true" }, svg("path", { d: ICONS[name] ?? "", fill: "currentColor" }));
}

export function save(text: string, name: string, type: string): void {
  const link = el("a", { href: URL.createObjectURL(new Blob([text], { type })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** The variable of a colour: of the palette by its number, by default that of the place, or by its name. */
export function variable(of: number | string | null, place = 0): string {
  return typeof of === "string" ? (of === "grey" ? "soft" : of) : `p${(of ?? place) % 9}`;
}

export function colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

const SUPER: Record<string, string> = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };

export function power(exponent: number): string {
  return "10" + [...String(exponent)].map((c) => SUPER[c] ?? c).join("");
}

/** A text whose numbers are set as the page sets its own: 1.5e-08 as 1.5·10⁻⁸, -2 as −2; names without marks. */
export function typeset(text: string): string {
  return text
    .replace(/`([^`]+)`/g, "$1")
    .replace(/(?<![\p{L}\p{N}_.])(\d+(?:\.\d+)?)e([+-]?)0*(\d+)(?![\p{L}\p{N}_])/gu, (_, m: string, sign: string, e: string) => `${m}·${power(Number(sign + e))}`)
    .replace(/(?<![\p{L}\p{N}_.)\]-])-(?=\d)/gu, "−");
}

/** A number for people: 3.142, 1.2·10⁻⁸. */
export function number(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e-3 && size < 1e5) return String(Number(value.toPrecision(digits))).replace("-", "−");
  const [mantissa, exponent] = value.toExponential(Math.max(1, digits - 2)).split("e");
  return `${String(Number(mantissa)).replace("-", "−")}·${power(Number(exponent))}`;
}

/** A share in per cent, as tables and sentences of the report have it; below a millionth as a number. */
export function fraction(share: number): string {
  if (share !== 0 && Math.abs(share) < 1e-6) return number(share, 2);
  const percent = 100 * share;
  return `${Math.abs(percent) >= 99.5 ? percent.toFixed(0) : number(percent, 2)} %`;
}
