// Reading a plot off, and zooming in: by pointer, and by keyboard as a slider along its axis.
import { bisector } from "d3-array";
import { useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { number } from "./format";
import { type Axis, type Curve, type Frame, MARGIN } from "./plot_frame";

const nearest = bisector((value: number) => value).center;

function at(curve: Curve, x: number): number | null {
  return curve.y[nearest(curve.x, x)] ?? null;
}

/** The values of all curves where the cursor is. */
export function Readings({ axis, curves }: { axis: Axis; curves: Curve[] }) {
  const x = axis.cursor.value;
  return (
    <span class="plot-readings">
      {curves.map((curve) => (
        <span key={curve.name} class={`reading reading-${curve.style ?? 0}`}>
          {x === null ? "" : number(at(curve, x))}
        </span>
      ))}
    </span>
  );
}

export function Cursor({ axis, curves, frame: { x, y, height } }: { axis: Axis; curves: Curve[]; frame: Frame }) {
  const cursor = axis.cursor.value;
  if (cursor === null) return null;
  return (
    <g class="plot-cursor">
      <line x1={x(cursor)} x2={x(cursor)} y2={height} />
      {curves.map((curve) => {
        const height = y(at(curve, cursor) ?? Number.NaN);
        return Number.isFinite(height) && <circle key={curve.name} r={3} cx={x(cursor)} cy={height} />;
      })}
    </g>
  );
}

/** Show a part of the axis: `factor` times as much as now around `centre`; all of it where that is as much. */
export function zoom(axis: Axis, factor: number, centre?: number): void {
  const [low, high] = axis.window.value ?? axis.domain;
  const middle = centre ?? axis.cursor.value ?? (low + high) / 2;
  const from = Math.max(axis.domain[0], middle - (middle - low) * factor);
  const until = Math.min(axis.domain[1], middle + (high - middle) * factor);
  axis.window.value = from <= axis.domain[0] && until >= axis.domain[1] ? null : [from, until];
}

/** What makes a plot answer to pointer and keyboard. */
export function useSteering(axis: Axis, curves: Curve[], frame: Frame | null) {
  const drag = useSignal<[number, number] | null>(null);
  const inside = (event: PointerEvent) => {
    const left = (event.currentTarget as Element).getBoundingClientRect().left + MARGIN.left;
    return Math.min(Math.max(event.clientX - left, 0), frame!.width);
  };
  const longest = curves.reduce<number[]>((found, { x }) => (x.length > found.length ? x : found), []);
  const snap = (value: number) => longest[nearest(longest, value)] ?? value;
  const move = (steps: number) => {
    const index = nearest(longest, axis.cursor.value ?? (axis.window.value ?? axis.domain)[0]);
    const moved = longest[Math.min(Math.max(index + steps, 0), longest.length - 1)];
    if (moved === undefined) return;
    axis.cursor.value = moved;
    const window = axis.window.value;
    // A window follows the cursor that would leave it.
    if (window && (moved < window[0] || moved > window[1])) {
      const shift = moved - (moved < window[0] ? window[0] : window[1]);
      axis.window.value = [window[0] + shift, window[1] + shift];
    }
  };
  const keys: Record<string, (event: KeyboardEvent) => void> = {
    ArrowRight: (event) => move(event.shiftKey ? 10 : 1),
    ArrowLeft: (event) => move(event.shiftKey ? -10 : -1),
    PageUp: () => move(20),
    PageDown: () => move(-20),
    Home: () => move(-longest.length),
    End: () => move(longest.length),
    "+": () => zoom(axis, 0.5),
    "-": () => zoom(axis, 2),
    "0": () => {
      axis.window.value = null;
    },
    Escape: () => {
      axis.cursor.value = null;
      axis.window.value = null;
    },
  };
  return {
    slider: (title: string): JSX.IntrinsicElements["div"] => {
      const x = axis.cursor.value ?? axis.domain[0];
      const values = curves.map((curve) => `${curve.name} ${number(at(curve, x))}`).join(", ");
      return {
        role: "slider",
        tabIndex: 0,
        "aria-label": `${title} over ${axis.label}`,
        "aria-valuemin": axis.domain[0],
        "aria-valuemax": axis.domain[1],
        "aria-valuenow": x,
        "aria-valuetext": `${axis.label} ${number(x)}: ${values}`,
        onKeyDown: (event: KeyboardEvent) => {
          const act = keys[event.key];
          if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
          event.preventDefault();
          act(event);
        },
      };
    },
    pointer: {
      onPointerDown: (event: PointerEvent) => {
        if (!frame || event.button !== 0) return;
        (event.currentTarget as Element).setPointerCapture(event.pointerId);
        drag.value = [inside(event), inside(event)];
      },
      onPointerMove: (event: PointerEvent) => {
        if (!frame) return;
        if (drag.value) drag.value = [drag.value[0], inside(event)];
        axis.cursor.value = snap(frame.x.invert(inside(event)));
      },
      onPointerUp: () => {
        if (!frame || !drag.value) return;
        const [from, until] = [...drag.value].sort((one, other) => one - other) as [number, number];
        // A click only moves the cursor.
        if (until - from > 5) axis.window.value = [frame.x.invert(from), frame.x.invert(until)];
        drag.value = null;
      },
      onPointerCancel: () => {
        drag.value = null;
      },
      onDblClick: () => {
        axis.window.value = null;
      },
    },
    selection: drag.value && frame && (
      <rect
        class="plot-selection"
        x={Math.min(...drag.value)}
        width={Math.abs(drag.value[1] - drag.value[0])}
        height={frame.height}
      />
    ),
  };
}

/** Buttons for all plots of an axis. */
export function ZoomButtons({ axis }: { axis: Axis }) {
  const window = axis.window.value;
  const cursor = axis.cursor.value;
  return (
    <div class="zoom" role="group" aria-label={`Zoom along ${axis.label}`}>
      <span class="zoom-where">
        {cursor !== null && <>{axis.label} = <b>{number(cursor)}</b></>}
      </span>
      <button type="button" onClick={() => zoom(axis, 0.5)} aria-label="Zoom in">+</button>
      <button type="button" onClick={() => zoom(axis, 2)} aria-label="Zoom out" disabled={!window}>−</button>
      <button type="button" onClick={() => { axis.window.value = null; }} disabled={!window}>All</button>
    </div>
  );
}
