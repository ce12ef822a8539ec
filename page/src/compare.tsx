// Several jobs laid over one another: one plot for each quantity, one table for their figures.
import { useMemo } from "preact/hooks";
import { getJson } from "./api";
import { figure, number, seconds } from "./format";
import { useLoaded } from "./load";
import { Section, Status, Trouble, WideTable } from "./parts";
import { to } from "./route";
import { type Flight, Trajectories } from "./trajectories";
import type { Job, Result } from "./types";

/** As many as there are styles of curves. */
const MOST = 6;

interface Compared {
  job: Job;
  result: Result;
}

async function compared(id: string, signal: AbortSignal): Promise<Compared> {
  const path = `/v1/jobs/${encodeURIComponent(id)}`;
  const [job, result] = await Promise.all([getJson<Job>(path, signal), getJson<Result>(`${path}/result`, signal)]);
  return { job, result };
}

export function Compare({ jobs }: { jobs: string[] }) {
  const ids = jobs.slice(0, MOST);
  const { data, error } = useLoaded((signal) => Promise.all(ids.map((id) => compared(id, signal))), [jobs.join()]);
  const flights = useMemo<Flight[]>(
    () => data.value?.map(({ job, result }, index) => ({ name: nameOf(job, index), trajectory: result.trajectory })) ?? [],
    [data.value],
  );
  return (
    <>
      <h1 tabIndex={-1}>Comparison</h1>
      <Trouble error={error.value} />
      {jobs.length > MOST && <p class="note">Only the first {MOST} jobs are shown.</p>}
      {data.value && (
        <>
          <Figures compared={data.value} />
          <Section title="Trajectories" id="trajectories">
            {/* Nobody would know whose the switching times are. */}
            <Trajectories flights={flights} result={{ ...data.value[0]?.result, switching: {} }} />
          </Section>
        </>
      )}
    </>
  );
}

function nameOf(job: Job, index: number): string {
  return `${index + 1}: ${job.name || job.id} (${job.method})`;
}

function Figures({ compared }: { compared: Compared[] }) {
  const first = compared[0]?.result.objective ?? null;
  return (
    <WideTable label="Figures of the jobs">
      <thead>
        <tr>
          <th scope="col">Job</th>
          <th scope="col">Status</th>
          <th scope="col">Verified</th>
          <th scope="col" class="right">Objective</th>
          <th scope="col" class="right">Difference</th>
          <th scope="col" class="right">Final time</th>
          <th scope="col" class="right">Iterations</th>
          <th scope="col" class="right">Solver's time</th>
        </tr>
      </thead>
      <tbody>
        {compared.map(({ job, result }, index) => (
          <tr key={job.id}>
            <th scope="row"><a href={to(`/jobs/${job.id}`)}>{nameOf(job, index)}</a></th>
            <td><Status status={job.status} /></td>
            <td class={result.success ? "good" : "bad"}>{result.success ? "✓ yes" : "✕ no"}</td>
            <td class="right">{figure(result.objective, 9)}</td>
            <td class="right">
              {index === 0 || first === null || result.objective === null ? "–" : number(result.objective - first, 3)}
            </td>
            <td class="right">{figure(result.final_time, 9)}</td>
            <td class="right">{result.statistics.iterations ?? "–"}</td>
            <td class="right">{seconds(result.statistics.seconds.total)}</td>
          </tr>
        ))}
      </tbody>
    </WideTable>
  );
}
