// Plots of every state, control and output of one or several answers, on one time axis.
import { useSignal } from "@preact/signals";
import { useMemo } from "preact/hooks";
import { number, span, withUnit } from "./format";
import { Plot } from "./plot";
import { ZoomButtons } from "./plot_cursor";
import type { Axis, Curve } from "./plot_frame";
import type { Constraint, Numbers, Result, Trajectory } from "./types";

/** A trajectory with the name that the legend gives it. */
export interface Flight {
  name: string;
  trajectory: Trajectory;
}

export interface Quantity {
  name: string;
  group: string;
  unit?: string;
  curves: Curve[];
  bounds: number[];
  active: [number, number][];
}

const GROUPS = ["states", "controls", "outputs"] as const;

/** What is to be plotted of some flights of the same problem; `result` says units and bounds. */
export function quantities(flights: Flight[], result: Partial<Result>): Quantity[] {
  const units: Record<string, string> = { ...result.resolved?.document.problem.units };
  for (const output of result.outputs ?? []) if (output.units) units[output.name] = output.units;
  const found = new Map<string, Quantity>();
  for (const group of GROUPS) {
    for (const [style, { name: flight, trajectory }] of flights.entries()) {
      for (const [name, values] of Object.entries(trajectory[group] ?? {})) {
        // A rated control is listed among the states too.
        if (group === "states" && trajectory.controls && name in trajectory.controls) continue;
        const known = found.get(name) ?? { name, group, unit: units[name], curves: [], ...boundsOf(name, result) };
        known.curves.push({ name: flight, x: trajectory.t, y: values as Numbers, style });
        found.set(name, known);
      }
    }
  }
  return [...found.values()];
}

function boundsOf(name: string, result: Partial<Result>): Pick<Quantity, "bounds" | "active"> {
  const constraint: Constraint | undefined = result.constraints?.find(
    ({ pointer }) => pointer === `/problem/bounds/${name.replaceAll("~", "~0").replaceAll("/", "~1")}`,
  );
  const bounds = constraint?.bounds.filter((bound): bound is number => bound !== null) ?? [];
  return { bounds, active: constraint?.active ?? [] };
}

/** `result` says units, bounds, and the switching times if they are those of all flights. */
export function Trajectories({ flights, result }: { flights: Flight[]; result: Partial<Result> }) {
  const window = useSignal<[number, number] | null>(null);
  const cursor = useSignal<number | null>(null);
  const shown = useMemo(() => quantities(flights, result), [flights, result]);
  const domain = useMemo(() => span(flights.flatMap(({ trajectory: { t } }) => [t[0] ?? 0, t.at(-1) ?? 1])), [flights]);
  const unit = result.resolved?.document.problem.units?.t;
  const axis: Axis = { label: withUnit("t", unit), domain, window, cursor };
  const switches = Object.entries(result.switching ?? {});
  const marks = switches.flatMap(([, found]) => found.times);
  return (
    <>
      <div class="plots-head">
        {flights.length > 1 && <Legend flights={flights} />}
        <Switches switches={switches} choose={(time) => { cursor.value = time; }} />
        <ZoomButtons axis={axis} />
      </div>
      <div class="plots">
        {shown.map(({ name, unit, curves, bounds, active }) => (
          <Plot key={name} name={name} unit={unit} axis={axis} curves={curves} bounds={bounds} active={active} marks={marks} />
        ))}
      </div>
    </>
  );
}

function Legend({ flights }: { flights: Flight[] }) {
  return (
    <ul class="legend">
      {flights.map(({ name }, style) => (
        <li key={name}>
          <svg width="22" height="8" class={`curve-${style}`} aria-hidden="true"><path d="M0 4H22" /></svg> {name}
        </li>
      ))}
    </ul>
  );
}

/** The switching times of each bounded control; one that is clicked is where all plots are read off. */
function Switches(props: { switches: [string, { times: number[] }][]; choose: (time: number) => void }) {
  const some = props.switches.filter(([, { times }]) => times.length > 0);
  return (
    <div class="switches">
      {some.map(([control, { times }]) => (
        <span key={control}>
          <span class="muted">{control} switches at</span>{" "}
          {times.map((time) => (
            <button key={time} type="button" class="quiet" onClick={() => props.choose(time)}>{number(time, 7)}</button>
          ))}
        </span>
      ))}
    </div>
  );
}
