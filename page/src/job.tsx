// One job: where it stands, how its solve goes, what came out, and what can be done with it.
import { useSignal } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import { getJson, isFinal, post, request } from "./api";
import { Convergence } from "./convergence";
import { Submitted } from "./document";
import { FlightsAnswer, FlightsHeadline } from "./flights";
import { between, number, when } from "./format";
import { type History, historyOf, useWatched } from "./history";
import { useLoaded } from "./load";
import { Downloads, Findings, Summary } from "./job_aside";
import { Action, Facts, Section, Status, Trouble } from "./parts";
import { go, to } from "./route";
import { Trajectories } from "./trajectories";
import type { Flights, Job, Result, Trajectory } from "./types";
import { Headline, Verified } from "./verification";
import { Wavelets } from "./wavelets";

export function JobPage({ id }: { id: string }) {
  const { job: watched, history, trajectory, error } = useWatched(id);
  const job = watched.value;
  const done = job !== null && isFinal(job.status);
  const found = useLoaded(
    async (signal) => (done ? getJson<Result | Flights>(`/v1/jobs/${id}/result`, signal) : null),
    [id, done],
  );
  const answer = found.data.value;
  const flights = answer && "kind" in answer ? answer : null;
  const result = answer && "trajectory" in answer ? answer : null;
  useEffect(() => {
    document.title = job ? `${job.status}: ${job.name || job.id} – ondelette` : "ondelette";
  }, [job?.status, job?.name]);
  return (
    <>
      <div class="title">
        <h1 tabIndex={-1}>{job?.name || id}</h1>
        <span role="status">{job && <Status status={job.status} />}</span>
        {job && <Buttons job={job} done={done} />}
      </div>
      <Trouble error={error.value} />
      {job && <Body job={job} done={done} result={result} flights={flights} history={history.value} trajectory={trajectory.value} />}
    </>
  );
}

interface Known {
  job: Job;
  done: boolean;
  result: Result | null;
  flights: Flights | null;
  history: History;
  trajectory: Trajectory | null;
}

function Body({ job, done, result, flights, history, trajectory }: Known) {
  return (
    <>
      {job.error && <div class="trouble"><p>{job.error.detail || job.error.title}</p></div>}
      {result && <Headline result={result} />}
      {flights && <FlightsHeadline flights={flights} />}
      {!done && <Now job={job} />}
      <div class="columns">
        <div>
          {!done && <Convergence history={history} />}
          {!done && trajectory && <Live trajectory={trajectory} />}
          {result && <Answer result={result} />}
          {flights && <FlightsAnswer flights={flights} />}
          {result && <Wavelets result={result} />}
          {done && !flights && <Passed result={result} told={history} />}
          <Submitted job={job} />
        </div>
        <aside aria-label="Summary">
          {result && <Verified result={result} />}
          {result && <Findings result={result} />}
          <Summary job={job} result={result} />
          {done && <Downloads job={job} result={(result ?? flights) !== null} />}
        </aside>
      </div>
    </>
  );
}

/** How the solve went: as the result has it, else (a genetic algorithm, no result) as it was told. */
function Passed({ result, told }: { result: Result | null; told: History }) {
  const kept = useMemo(() => (result ? historyOf(result) : told), [result, told]);
  return <Convergence history={kept.iteration.length > 0 ? kept : told} />;
}

function Buttons({ job, done }: { job: Job; done: boolean }) {
  const erase = async () => {
    if (!confirm("Erase this job, with its document and its result?")) return;
    await request(`/v1/jobs/${job.id}`, { method: "DELETE" });
    go(to("/"));
  };
  return (
    <div class="buttons">
      {!done && (
        <Action kind="danger" act={async () => { await post(`/v1/jobs/${job.id}/cancel`); }} disabled={job.cancel_requested}>
          Cancel
        </Action>
      )}
      {!job.flights_of && <a class="button" href={to("/new", { from: job.id })}>Run again with changes</a>}
      {done && !job.flights_of && <CompareWith job={job} />}
      {done && <Action kind="danger" act={erase}>Erase</Action>}
    </div>
  );
}

/** Chooses another job to be laid over this one. */
function CompareWith({ job }: { job: Job }) {
  const { data } = useLoaded((signal) => getJson<{ jobs: Job[] }>("/v1/jobs?limit=50", signal), [job.id]);
  const others =
    data.value?.jobs.filter((other) => other.id !== job.id && !other.flights_of && isFinal(other.status)) ?? [];
  const choose = (event: Event) => {
    const other = (event.currentTarget as HTMLSelectElement).value;
    if (other) go(to("/compare", { jobs: `${job.id},${other}` }));
  };
  return (
    <select aria-label="Compare with another job" onChange={choose} disabled={others.length === 0}>
      <option value="">Compare with …</option>
      {others.map((other) => (
        <option key={other.id} value={other.id}>{`${other.name || other.id}, ${other.method}, ${when(other.created_at)}`}</option>
      ))}
    </select>
  );
}

/** Where a job stands that has not ended. */
function Now({ job }: { job: Job }) {
  // The time that has passed is told anew every second.
  const tick = useSignal(0);
  useEffect(() => {
    const timer = setInterval(() => { tick.value++; }, 1000);
    return () => clearInterval(timer);
  }, []);
  tick.value;
  const { progress } = job;
  const done = <progress key="done" value={progress?.fraction ?? undefined} max={1} aria-label="Estimate of what is done" />;
  return (
    <Facts
      strip
      facts={[
        ["done", done],
        ["stage", progress?.stage ?? (job.status === "queued" ? "waits for a worker" : "starts")],
        ["iteration", progress?.iteration ?? "–"],
        ["objective", number(progress?.objective, 9)],
        ["infeasibility", number(progress?.infeasibility, 3)],
        ["running for", between(job.started_at, job.finished_at)],
      ]}
    />
  );
}

function Live({ trajectory }: { trajectory: Trajectory }) {
  const flights = useMemo(() => [{ name: "iterate", trajectory }], [trajectory]);
  return (
    <Section title="The iterate, as it is now" id="iterate">
      <Trajectories flights={flights} result={{}} />
    </Section>
  );
}

function Answer({ result }: { result: Result }) {
  const flights = useMemo(() => {
    const plants = Object.entries(result.scenarios ?? {});
    if (plants.length === 0) return [{ name: "answer", trajectory: result.trajectory }];
    return plants.map(([name, { trajectory }]) => ({ name, trajectory }));
  }, [result]);
  return (
    <Section title="Trajectory" id="trajectory">
      <Trajectories flights={flights} result={result} />
    </Section>
  );
}
