// A plot over time (or iterations, or a parameter): curves, bounds, marks; its cursor and zoom are shared with
// all plots of the same view. SVG, so that it prints, and follows the colours of the page.
import { range } from "d3-array";
import { scaleLinear } from "d3-scale";
import { line } from "d3-shape";
import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { number, withUnit } from "./format";
import { Cursor, Readings, useSteering } from "./plot_cursor";
import { type Curve, decades, type Frame, framed, MARGIN, type PlotProps, type Scale } from "./plot_frame";

export function Plot(props: PlotProps) {
  const { name, unit, axis, curves, height = 168 } = props;
  const box = useRef<HTMLDivElement>(null);
  const width = useWidth(box);
  const window = axis.window.value ?? axis.domain;
  const frame = useMemo(
    () => framed(props, window, width - MARGIN.left - MARGIN.right, height - MARGIN.top - MARGIN.bottom),
    [curves, props.bounds, props.log, axis.log, window[0], window[1], width, height],
  );
  const steering = useSteering(axis, curves, frame);
  const title = withUnit(name, unit);
  return (
    <figure class="plot" data-name={name}>
      <figcaption>
        <span class="plot-name">{title}</span>
        <Readings axis={axis} curves={curves} />
      </figcaption>
      <div ref={box} class="plot-box" style={{ height }} {...steering.slider(title)}>
        {frame && (
          <svg width={width} height={height} aria-hidden="true" {...steering.pointer}>
            <Axes frame={frame} label={axis.label} />
            <svg x={MARGIN.left} y={MARGIN.top} width={frame.width} height={frame.height} class="plot-inside">
              <Marks {...props} frame={frame} />
              {curves.map((curve) => (
                <CurvePath key={curve.name} curve={curve} frame={frame} dots={props.dots} />
              ))}
              <Cursor axis={axis} curves={curves} frame={frame} />
              {steering.selection}
            </svg>
          </svg>
        )}
      </div>
    </figure>
  );
}

/** The width that an element has, as it changes. */
export function useWidth(box: { current: HTMLElement | null }): number {
  const width = useSignal(0);
  useEffect(() => {
    const observer = new ResizeObserver(([entry]) => {
      width.value = Math.floor(entry!.contentRect.width);
    });
    observer.observe(box.current!);
    return () => observer.disconnect();
  }, []);
  return width.value;
}

function Axes({ frame: { x, y, width, height }, label }: { frame: Frame; label: string }) {
  const across = x.ticks(Math.max(2, Math.floor(width / 80)));
  const [left, top] = [MARGIN.left, MARGIN.top];
  return (
    <g class="plot-axes" transform={`translate(${left},${top})`}>
      {upward(y, height).map(([tick, text]) => (
        <g key={tick} transform={`translate(0,${y(tick)})`}>
          <line x2={width} />
          <text x={-6} dy="0.32em" text-anchor="end">{text}</text>
        </g>
      ))}
      {across.map((tick) => (
        <g key={tick} transform={`translate(${x(tick)},0)`}>
          <line y2={height} />
          <text y={height + 13} text-anchor="middle">{plain(tick, x.tickFormat(across.length))}</text>
        </g>
      ))}
      <rect width={width} height={height} />
      <text class="plot-label" x={width} y={height + 26} text-anchor="end">{label}</text>
    </g>
  );
}

/** Large and small numbers would not fit beside the axis. */
function plain(tick: number, text: (tick: number) => string): string {
  const size = Math.abs(tick);
  return size !== 0 && (size >= 1e6 || size < 1e-3) ? number(tick, 3) : text(tick);
}

/** The ticks of the upward axis with their texts: on a long logarithmic axis whole powers of ten that have room. */
function upward(y: Scale, height: number): [number, string][] {
  const [low, high] = y.domain() as [number, number];
  if ("base" in y && decades(low, high)) {
    const [first, last] = [Math.ceil(Math.log10(low) - 1e-9), Math.floor(Math.log10(high) + 1e-9)];
    const step = Math.max(1, Math.ceil((last - first) / Math.max(1, Math.floor(height / 26))));
    return range(first, last + 1, step).map((power) => [10 ** power, `1e${power}`.replace("-", "−")]);
  }
  const even = scaleLinear().domain([low, high]);
  const ticks = even.ticks(Math.max(2, Math.floor(height / 32)));
  // On a logarithmic axis they come ever closer.
  const apart = ticks.reduce<number[]>((kept, tick) => {
    const last = kept.at(-1);
    return last !== undefined && y(last) - y(tick) < 14 ? kept : [...kept, tick];
  }, []);
  return apart.map((tick) => [tick, plain(tick, even.tickFormat(ticks.length))]);
}

function Marks({ marks, bounds, active, frame: { x, y, width, height } }: PlotProps & { frame: Frame }) {
  return (
    <g class="plot-marks">
      {marks?.map((at) => <line key={at} class="switch" x1={x(at)} x2={x(at)} y2={height} />)}
      {bounds?.map((bound) => <line key={bound} class="bound" x2={width} y1={y(bound)} y2={y(bound)} />)}
      {active?.map(([from, until]) => (
        <rect key={from} class="active" x={x(from)} width={Math.max(1, x(until) - x(from))} y={height - 3} height={3} />
      ))}
    </g>
  );
}

function CurvePath({ curve, frame: { x, y }, dots }: { curve: Curve; frame: Frame; dots?: boolean }) {
  const drawn = useMemo(() => {
    const path = line<number>()
      .defined((index) => Number.isFinite(y(curve.y[index] ?? Number.NaN)))
      .x((index) => x(curve.x[index]!))
      .y((index) => y(curve.y[index]!));
    const indices = curve.x.map((_, index) => index);
    const points = dots ? indices.filter((index) => path.defined()(index, index, indices)) : [];
    return { path: path(indices) ?? "", points };
  }, [curve.x, curve.y, curve.x.length, x, y, dots]);
  return (
    <g class={`curve curve-${curve.style ?? 0}`} data-curve={curve.name}>
      <path d={drawn.path} />
      {drawn.points.map((index) => <circle key={index} r={2.5} cx={x(curve.x[index]!)} cy={y(curve.y[index]!)} />)}
    </g>
  );
}
