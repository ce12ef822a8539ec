// How a solve goes: objective and infeasibility over the iterations.
import { useSignal } from "@preact/signals";
import { useMemo } from "preact/hooks";
import type { History } from "./history";
import { ZoomButtons } from "./plot_cursor";
import { Plot } from "./plot";
import type { Axis, Curve } from "./plot_frame";
import { Section } from "./parts";
import type { Numbers } from "./types";

/** Of more stages, their beginnings would hide the curves. */
const MOST_STAGES = 12;

export function Convergence({ history }: { history: History }) {
  const window = useSignal<[number, number] | null>(null);
  const cursor = useSignal<number | null>(null);
  const { iteration, stages } = history;
  const [first = 0, last = 1] = [iteration[0], iteration.at(-1)];
  const axis: Axis = { label: "iteration", domain: [first, Math.max(last, first + 1)], window, cursor };
  const plots = useMemo(() => plotted(history), [history]);
  const few = stages.length <= MOST_STAGES;
  return (
    <Section title="Convergence" id="convergence" aside={<ZoomButtons axis={axis} />}>
      {plots.length === 0 && <p class="empty">No iteration has been told of yet.</p>}
      <div class="plots">
        {plots.map(({ name, curves, log }) => (
          <Plot
            key={curves[0]!.name}
            name={name}
            axis={axis}
            curves={curves}
            log={log}
            marks={few ? stages.slice(1).map((stage) => stage.at) : []}
            dots={iteration.length < 60}
          />
        ))}
      </div>
      {stages.length > 1 && few && (
        <p class="note">Stages: {stages.map((stage) => `${stage.name} from ${stage.at}`).join(", ")}.</p>
      )}
    </Section>
  );
}

/** Objective and infeasibility, on logarithmic axes where they are positive; what was never told of is left out. */
function plotted({ iteration, objective, infeasibility }: History): { name: string; curves: Curve[]; log: boolean }[] {
  const known = (values: Numbers) => values.filter((value) => value !== null);
  const positive = known(objective).every((value) => value > 0);
  const plots = [
    { name: positive ? "objective" : "objective (linear: not always positive)", values: objective, log: positive },
    { name: "infeasibility", values: infeasibility, log: true },
  ];
  return plots
    .filter(({ values, log }) => known(values).some((value) => !log || value > 0))
    .map(({ name, values, log }) => ({ name, curves: [{ name: name.split(" ")[0]!, x: iteration, y: values }], log }));
}
