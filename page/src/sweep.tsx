// A sweep: how far it is, the objective over a parameter, and the table of its points.
import { useSignal } from "@preact/signals";
import { useMemo } from "preact/hooks";
import { download, getJson, post, refused } from "./api";
import { figure, leaf, number, seconds, span, when } from "./format";
import { usePolling } from "./load";
import { Action, Section, Status, Trouble, WideTable } from "./parts";
import { Plot } from "./plot";
import { ZoomButtons } from "./plot_cursor";
import type { Axis, Curve } from "./plot_frame";
import { to } from "./route";
import type { Sweep, SweepRow } from "./types";

const ROWS = 100;
const STYLES = 6;

export function SweepPage({ id }: { id: string }) {
  const sweep = useSignal<Sweep | null>(null);
  const error = useSignal<Error | null>(null);
  const path = `/v1/sweeps/${encodeURIComponent(id)}`;
  usePolling(
    async () => {
      try {
        sweep.value = await getJson<Sweep>(path);
        error.value = null;
      } catch (reason) {
        error.value = reason as Error;
      }
    },
    () => (sweep.value?.finished_at || refused(error.value) ? null : 1000),
    [id],
  );
  const { value } = sweep;
  return (
    <>
      <div class="title">
        <h1 tabIndex={-1}>{value?.name || "Sweep"}</h1>
        <span role="status">{value && <Status status={value.status} />}</span>
        <div class="buttons">
          {value && !value.finished_at && (
            <Action kind="danger" act={async () => { await post(`${path}/cancel`); }}>Cancel</Action>
          )}
          <Action act={() => download(`${path}/result?format=csv`, `${id}.csv`)} disabled={!value}>CSV</Action>
          <Action act={() => download(`${path}/result?format=npz`, `${id}.npz`)} disabled={!value}>NPZ</Action>
        </div>
      </div>
      <Trouble error={error.value} />
      {value && <Body sweep={value} rows={value.table ?? []} />}
    </>
  );
}

function Body({ sweep, rows }: { sweep: Sweep; rows: SweepRow[] }) {
  return (
    <>
      <p class="note">
        {sweep.points} points, submitted {when(sweep.created_at)}:{" "}
        {Object.entries(sweep.counts)
          .filter(([, count]) => count > 0)
          .map(([status, count]) => `${count} ${status}`)
          .join(", ")}
        .
      </p>
      <Picture sweep={sweep} rows={rows} />
      <Points sweep={sweep} rows={rows} />
    </>
  );
}

const DRAWN = ["objective", "final_time", "iterations"] as const;

function Picture({ sweep, rows }: { sweep: Sweep; rows: SweepRow[] }) {
  const window = useSignal<[number, number] | null>(null);
  const cursor = useSignal<number | null>(null);
  const numeric = sweep.pointers.filter((pointer) => rows.every((row) => typeof row.point[pointer] === "number"));
  const pointer = useSignal(numeric[0]);
  const log = useSignal(false);
  const over = pointer.value;
  const curves = useMemo(
    () => (over === undefined ? [] : DRAWN.map((name) => curvesOf(rows, over, name))),
    [rows, over],
  );
  if (over === undefined) return null;
  const domain = span(rows.map((row) => row.point[over] as number));
  const axis: Axis = { label: leaf(over), domain, log: log.value && domain[0] > 0, window, cursor };
  const choose = (event: Event) => {
    pointer.value = (event.currentTarget as HTMLSelectElement).value;
    window.value = null;
  };
  const aside = (
    <div class="zoom">
      {numeric.length > 1 && (
        <label>
          over
          <select value={over} onChange={choose}>
            {numeric.map((other) => <option key={other} value={other}>{leaf(other)}</option>)}
          </select>
        </label>
      )}
      <label><input type="checkbox" checked={log.value} onChange={() => { log.value = !log.value; }} disabled={domain[0] <= 0} /> log axis</label>
      <ZoomButtons axis={axis} />
    </div>
  );
  return (
    <Section title={`Over ${leaf(over)}`} id="picture" aside={aside}>
      <div class="plots">
        {DRAWN.map((name, index) => (
          <Plot
            key={name}
            name={name.replace("_", " ")}
            axis={axis}
            curves={curves[index]!}
            dots={rows.length <= 500}
          />
        ))}
      </div>
    </Section>
  );
}

/** A curve for each combination of the other parameters, as many as there are styles. */
function curvesOf(rows: SweepRow[], pointer: string, drawn: (typeof DRAWN)[number]): Curve[] {
  const groups = new Map<string, SweepRow[]>();
  for (const row of rows) {
    const others = Object.entries(row.point).filter(([name]) => name !== pointer);
    const name = others.map(([name, value]) => `${leaf(name)} = ${JSON.stringify(value)}`).join(", ") || drawn;
    groups.set(name, [...(groups.get(name) ?? []), row]);
  }
  return [...groups].slice(0, STYLES).map(([name, members], style) => {
    const sorted = members.toSorted((one, other) => (one.point[pointer] as number) - (other.point[pointer] as number));
    return {
      name,
      x: sorted.map((row) => row.point[pointer] as number),
      // What was not verified is no answer.
      y: sorted.map((row) => (row.verification?.passed ? row[drawn] : null)),
      style,
    };
  });
}

function Points({ sweep, rows }: { sweep: Sweep; rows: SweepRow[] }) {
  const first = useSignal(0);
  const last = Math.min(first.value + ROWS, rows.length);
  return (
    <Section title="Points" id="points">
      <WideTable label="Table of points">
        <thead>
          <tr>
            {sweep.pointers.map((pointer) => <th key={pointer} scope="col" title={pointer}>{leaf(pointer)}</th>)}
            <th scope="col">Job</th>
            <th scope="col" class="right">Objective</th>
            <th scope="col" class="right">Final time</th>
            <th scope="col">Verified</th>
            <th scope="col" class="right">State error</th>
            <th scope="col" class="right">Iterations</th>
            <th scope="col" class="right">Took</th>
          </tr>
        </thead>
        <tbody>
          {rows.slice(first.value, last).map((row) => (
            <tr key={row.index}>
              {sweep.pointers.map((pointer) => <td key={pointer}>{shown(row.point[pointer])}</td>)}
              <td><a href={to(`/jobs/${row.job}`)}><Status status={row.status} /></a></td>
              <td class="right">{figure(row.objective, 8)}</td>
              <td class="right">{figure(row.final_time, 8)}</td>
              <Verdict row={row} />
              <td class="right">{number(row.verification?.max_state_error, 3)}</td>
              <td class="right">{row.iterations ?? "–"}</td>
              <td class="right">{seconds(row.seconds)}</td>
            </tr>
          ))}
        </tbody>
      </WideTable>
      {rows.length > ROWS && (
        <nav class="pager" aria-label="Pages of points">
          <button type="button" disabled={first.value === 0} onClick={() => { first.value -= ROWS; }}>Before</button>
          <span>{first.value + 1} to {last} of {rows.length}</span>
          <button type="button" disabled={last >= rows.length} onClick={() => { first.value += ROWS; }}>After</button>
        </nav>
      )}
    </Section>
  );
}

function Verdict({ row }: { row: SweepRow }) {
  if (row.verification) return <td class={row.verification.passed ? "good" : "bad"}>{row.verification.passed ? "✓ yes" : "✕ no"}</td>;
  return <td class={row.error ? "bad" : "muted"}>{row.error ?? "–"}</td>;
}

function shown(value: unknown): string {
  return typeof value === "number" ? number(value) : JSON.stringify(value);
}
