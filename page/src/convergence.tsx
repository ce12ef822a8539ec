// How a solve goes: objective and infeasibility over the iterations.
import { useSignal } from "@preact/signals";
import { useMemo } from "preact/hooks";
import type { History } from "./history";
import { ZoomButtons } from "./plot_cursor";
import { Plot } from "./plot";
import type { Axis } from "./plot_frame";
import { Section } from "./parts";

export function Convergence({ history }: { history: History }) {
  const window = useSignal<[number, number] | null>(null);
  const cursor = useSignal<number | null>(null);
  const { iteration, objective, infeasibility, stages } = history;
  const [first = 0, last = 1] = [iteration[0], iteration.at(-1)];
  const axis: Axis = { label: "iteration", domain: [first, Math.max(last, first + 1)], window, cursor };
  const curves = useMemo(
    () => ({
      objective: [{ name: "objective", x: iteration, y: objective }],
      infeasibility: [{ name: "infeasibility", x: iteration, y: infeasibility }],
    }),
    [history],
  );
  const positive = objective.every((value) => value === null || value > 0);
  const marks = stages.slice(1).map((stage) => stage.at);
  return (
    <Section title="Convergence" id="convergence" aside={<ZoomButtons axis={axis} />}>
      {iteration.length === 0 ? (
        <p class="empty">No iteration has been told of yet.</p>
      ) : (
        <>
          <div class="plots">
            <Plot
              name={positive ? "objective" : "objective (linear, for it is not always positive)"}
              axis={axis}
              curves={curves.objective}
              log={positive}
              marks={marks}
              dots={iteration.length < 60}
            />
            <Plot name="infeasibility" axis={axis} curves={curves.infeasibility} log marks={marks} dots={iteration.length < 60} />
          </div>
          {stages.length > 1 && (
            <p class="note">Stages: {stages.map((stage) => `${stage.name} from ${stage.at}`).join(", ")}.</p>
          )}
        </>
      )}
    </Section>
  );
}
