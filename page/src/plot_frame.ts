// What a plot shows and how it lies on the screen.
import { bisector } from "d3-array";
import { type ScaleContinuousNumeric, scaleLinear, scaleLog } from "d3-scale";
import type { Signal } from "@preact/signals";
import { span } from "./format";
import type { Numbers } from "./types";

export interface Curve {
  name: string;
  x: number[];
  y: Numbers;
  /** Which of the styles of the legend it has; 0 is the accent colour. */
  style?: number;
}

/** What the plots of one view share. */
export interface Axis {
  label: string;
  domain: [number, number];
  log?: boolean;
  window: Signal<[number, number] | null>;
  cursor: Signal<number | null>;
}

export interface PlotProps {
  name: string;
  unit?: string;
  axis: Axis;
  curves: Curve[];
  /** Vertical lines: switching times, stages. */
  marks?: number[];
  /** Horizontal dashed lines. */
  bounds?: number[];
  /** Where a bound is active. */
  active?: [number, number][];
  log?: boolean;
  dots?: boolean;
  height?: number;
}

export type Scale = ScaleContinuousNumeric<number, number>;

export const MARGIN = { top: 6, right: 10, bottom: 30, left: 58 };

export interface Frame {
  x: Scale;
  y: Scale;
  width: number;
  height: number;
}

export function framed(props: PlotProps, window: [number, number], width: number, height: number): Frame | null {
  if (width <= 0) return null;
  const x = (props.axis.log ? scaleLog() : scaleLinear()).domain(window).range([0, width]);
  const seen = props.curves.flatMap((curve) => visible(curve, window, props.log));
  let [low, high] = span(seen, props.log ? [0.1, 1] : [0, 1]);
  for (const bound of props.bounds ?? []) {
    // A bound that is far away would only squeeze the curve.
    const reach = 0.6 * (high - low) || Math.abs(high) || 1;
    if (bound > low - reach && bound < high + reach) [low, high] = [Math.min(low, bound), Math.max(high, bound)];
  }
  const range: [number, number] = [height, 0];
  if (props.log) {
    const y = scaleLog().range(range);
    // Decades, if there are some.
    return { x, y: decades(low, high) ? y.domain([low, high]).nice() : y.domain([low / 1.2, high * 1.2]), width, height };
  }
  // What differs only by rounding is a constant.
  const pad = high - low > 1e-9 * Math.abs(high) ? 0.06 * (high - low) : 0.5 * Math.abs(high) || 1;
  return { x, y: scaleLinear().domain([low - pad, high + pad]).range(range), width, height };
}

/** The values inside a window, with the nearest ones on both sides. */
function visible(curve: Curve, [from, until]: [number, number], log?: boolean): Numbers {
  const { left, right } = bisector((value: number) => value);
  const inside = curve.y.slice(Math.max(0, left(curve.x, from) - 1), right(curve.x, until) + 1);
  return log ? inside.map((value) => (value !== null && value > 0 ? value : null)) : inside;
}

/** Whether an axis over these values is marked by powers of ten. */
export function decades(low: number, high: number): boolean {
  return high / low > 30;
}
