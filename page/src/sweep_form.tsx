// A sweep over one number of the document in the editor.
import { useSignal } from "@preact/signals";
import { post } from "./api";
import { Action } from "./parts";
import { go, to } from "./route";
import type { Json, Sweep } from "./types";

export function SweepForm({ document }: { document: () => Json }) {
  const pointer = useSignal("");
  const from = useSignal("");
  const until = useSignal("");
  const count = useSignal("11");
  const log = useSignal(false);
  const offered = useSignal<[string, Json][]>([]);
  const open = () => {
    offered.value = numbersIn(document());
  };
  const choose = (event: Event) => {
    pointer.value = (event.currentTarget as HTMLSelectElement).value;
    const now = offered.value.find(([path]) => path === pointer.value)?.[1];
    if (typeof now !== "number") return;
    from.value = String(now * 0.5);
    until.value = String(now * 1.5);
  };
  const run = async () => {
    const range = { from: expression(from.value), to: expression(until.value), count: Number(count.value), scale: log.value ? "log" : "linear" };
    const sweep = await post<Sweep>("/v1/sweeps", JSON.stringify({ document: document(), grid: { [pointer.value]: range } }));
    go(to(`/sweeps/${sweep.id}`));
  };
  return (
    <details class="sweep-form" onToggle={open}>
      <summary>Sweep over a number of the document</summary>
      <div class="filters">
        <label class="wide">
          Number
          <select name="pointer" value={pointer.value} onChange={choose}>
            <option value="">choose</option>
            {offered.value.map(([path]) => <option key={path}>{path}</option>)}
          </select>
        </label>
        <label>From <input name="from" value={from.value} onInput={(event) => { from.value = event.currentTarget.value; }} /></label>
        <label>To <input name="to" value={until.value} onInput={(event) => { until.value = event.currentTarget.value; }} /></label>
        <label>
          Points <input name="count" type="number" min="1" max="10000" value={count.value} onInput={(event) => { count.value = event.currentTarget.value; }} />
        </label>
        <label class="check">
          <input type="checkbox" checked={log.value} onChange={() => { log.value = !log.value; }} /> logarithmic
        </label>
        <Action act={run} disabled={!pointer.value}>Run the sweep</Action>
      </div>
    </details>
  );
}

/** A bound of the range is a number or an expression. */
function expression(text: string): Json {
  return text.trim() !== "" && Number.isFinite(Number(text)) ? Number(text) : text;
}

/** All numbers of the problem and the method, by pointer. */
function numbersIn(document: Json, pointer = ""): [string, Json][] {
  if (typeof document === "number") return [[pointer, document]];
  if (document === null || typeof document !== "object") return [];
  return Object.entries(document)
    .filter(([name]) => pointer !== "" || name === "problem" || name === "method" || name === "options")
    .flatMap(([name, value]) => numbersIn(value, `${pointer}/${name.replaceAll("~", "~0").replaceAll("/", "~1")}`));
}
