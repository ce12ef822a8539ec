// Numbers and times as people read them.
import { extent } from "d3-array";

/** A number with so many significant digits, but for zeros at its end; exponents where they are shorter. */
export function number(value: number | null | undefined, digits = 6): string {
  return figure(value, digits).replace(/(\.\d*?)0+(?=e|$)/, "$1").replace(/\.(?=e|$)/, "");
}

/** The same with its zeros, for numbers that stand below one another. */
export function figure(value: number | null | undefined, digits: number): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e6 || size < 1e-4 ? value.toExponential(digits - 1) : value.toPrecision(digits);
  return text.replaceAll("-", "−").replace("e+", "e");
}

export function seconds(value: number | null | undefined): string {
  if (value === null || value === undefined) return "–";
  if (value < 60) return `${figure(value, 3)} s`;
  return `${Math.floor(value / 60)} min ${Math.round(value % 60)} s`;
}

const moment = new Intl.DateTimeFormat(undefined, { dateStyle: "medium", timeStyle: "medium" });

export function when(text: string | null): string {
  return text === null ? "–" : moment.format(new Date(text));
}

/** The time between two moments, in words; until now where the second one is not there. */
export function between(from: string | null, until: string | null): string {
  if (from === null) return "–";
  const end = until === null ? Date.now() : Date.parse(until);
  return seconds(Math.max(0, (end - Date.parse(from)) / 1000));
}

export function withUnit(name: string, unit: string | undefined | null): string {
  return unit ? `${name} [${unit}]` : name;
}

/** The span of all numbers, or `other` where there are none. */
export function span(values: Iterable<number | null>, other: [number, number] = [0, 1]): [number, number] {
  const [low, high] = extent(values, (value) => value ?? undefined);
  return low === undefined || high === undefined ? other : [low, high];
}

/** The last word of a JSON pointer, for people. */
export function leaf(pointer: string): string {
  return (pointer.split("/").pop() ?? pointer).replaceAll("~1", "/").replaceAll("~0", "~");
}
