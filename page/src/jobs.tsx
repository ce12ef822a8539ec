// The list of jobs: newest first, a page at a time, each as it stands now.
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { getJson, isFinal, refused } from "./api";
import { between, when } from "./format";
import { useLoaded, usePolling } from "./load";
import { Status, Trouble, WideTable } from "./parts";
import { go, route, to } from "./route";
import type { Job, Method } from "./types";

const ROWS = 50;
const STATUSES = ["queued", "running", "succeeded", "failed", "cancelled"];
const FILTERS = ["status", "method", "tag", "name"] as const;

interface Page {
  jobs: Job[];
  next: string | null;
}

/** A full page of jobs, if there are so many: with filters, the service may give fewer at a time. */
async function pageOf(query: URLSearchParams): Promise<Page> {
  const jobs: Job[] = [];
  const parameters = new URLSearchParams(query);
  while (true) {
    parameters.set("limit", String(ROWS - jobs.length));
    const part = await getJson<{ jobs: Job[]; next_cursor: string | null }>(`/v1/jobs?${parameters}`);
    jobs.push(...part.jobs);
    if (part.next_cursor === null || jobs.length >= ROWS) return { jobs, next: part.next_cursor };
    parameters.set("cursor", part.next_cursor);
  }
}

export function Jobs() {
  const { query } = route.value;
  const page = useSignal<Page | null>(null);
  const error = useSignal<Error | null>(null);
  const chosen = useSignal<string[]>([]);
  // The cursors of the pages before this one.
  const before = useSignal<string[]>([]);
  const filters = FILTERS.map((name) => query.get(name) ?? "").join("\n");
  useEffect(() => {
    before.value = [];
  }, [filters]);
  usePolling(
    async () => {
      try {
        page.value = await pageOf(query);
        error.value = null;
      } catch (reason) {
        error.value = reason as Error;
      }
    },
    () => {
      // Not again before there is another key.
      if (refused(error.value)) return null;
      return page.value?.jobs.some((job) => !isFinal(job.status)) ? 1000 : 3000;
    },
    [query.toString()],
  );
  const step = (cursor: string | undefined) => go(to("/", { ...Object.fromEntries(query), cursor }));
  const backward = () => {
    const cursor = before.value.at(-1);
    before.value = before.value.slice(0, -1);
    step(cursor);
  };
  const forward = () => {
    before.value = [...before.value, query.get("cursor") ?? ""];
    step(page.value?.next ?? undefined);
  };
  return (
    <>
      <div class="title">
        <h1 tabIndex={-1}>Jobs</h1>
        <a class="button primary" href={to("/new")}>New job</a>
      </div>
      <Filters />
      <Trouble error={error.value} />
      {page.value && <Table jobs={page.value.jobs} chosen={chosen.value} choose={(ids) => { chosen.value = ids; }} />}
      <nav class="pager" aria-label="Pages">
        <button type="button" onClick={backward} disabled={!query.get("cursor")}>Newer</button>
        <button type="button" onClick={forward} disabled={!page.value?.next}>Older</button>
        <button
          type="button"
          disabled={chosen.value.length < 2}
          onClick={() => go(to("/compare", { jobs: chosen.value.join(",") }))}
        >
          Compare{chosen.value.length > 1 ? ` ${chosen.value.length} jobs` : " …"}
        </button>
      </nav>
    </>
  );
}

function Filters() {
  const { query } = route.value;
  const methods = useLoaded((signal) => getJson<{ methods: Method[] }>("/v1/methods", signal), []);
  const set = (event: Event) => {
    const { name, value } = event.currentTarget as HTMLInputElement;
    const { cursor: _, ...kept } = Object.fromEntries(query);
    go(to("/", { ...kept, [name]: value.trim() }));
  };
  const choice = (name: string, label: string, values: string[]) => (
    <label>
      {label}
      <select name={name} value={query.get(name) ?? ""} onChange={set}>
        <option value="">any</option>
        {values.map((value) => <option key={value}>{value}</option>)}
      </select>
    </label>
  );
  return (
    <form class="filters" role="search" aria-label="Filter jobs" onSubmit={(event) => event.preventDefault()}>
      {choice("status", "Status", STATUSES)}
      {choice("method", "Method", methods.data.value?.methods.map((method) => method.name) ?? [])}
      <label>
        Tag
        <input name="tag" value={query.get("tag") ?? ""} onChange={set} />
      </label>
      <label class="wide">
        Name
        <input name="name" value={query.get("name") ?? ""} onChange={set} placeholder="the whole name" />
      </label>
      {FILTERS.some((name) => query.get(name)) && <a href={to("/")}>Clear</a>}
    </form>
  );
}

function Table({ jobs, chosen, choose }: { jobs: Job[]; chosen: string[]; choose: (ids: string[]) => void }) {
  const { query } = route.value;
  if (jobs.length === 0) {
    return <p class="empty">{query.toString() ? "No job is like this." : "No jobs yet. Start one with “New job”."}</p>;
  }
  const tick = (id: string) => choose(chosen.includes(id) ? chosen.filter((other) => other !== id) : [...chosen, id]);
  return (
    <WideTable label="Table of jobs" kind="jobs">
      <thead>
        <tr>
          <th scope="col"><span class="unseen">Compare</span></th>
          <th scope="col">Status</th>
          <th scope="col">Name</th>
          <th scope="col">Method</th>
          <th scope="col">Progress</th>
          <th scope="col" class="right">Took</th>
          <th scope="col">Submitted</th>
        </tr>
      </thead>
      <tbody>
        {jobs.map((job) => (
          <tr key={job.id} data-job={job.id}>
            <td>
              <input
                type="checkbox"
                aria-label={`Compare ${job.name || job.id}`}
                checked={chosen.includes(job.id)}
                onChange={() => tick(job.id)}
              />
            </td>
            <td><Status status={job.status} /></td>
            <td class="name">
              <a href={to(`/jobs/${job.id}`)}>{job.name || job.id}</a>
              {job.sweep && <a class="tag" href={to(`/sweeps/${job.sweep}`)}>sweep</a>}
              {job.tags.map((tag) => <a key={tag} class="tag" href={to("/", { tag })}>{tag}</a>)}
            </td>
            <td>{job.method}</td>
            <td><Progress job={job} /></td>
            <td class="right">{between(job.started_at, job.finished_at)}</td>
            <td class="time">{when(job.created_at)}</td>
          </tr>
        ))}
      </tbody>
    </WideTable>
  );
}

function Progress({ job }: { job: Job }) {
  if (job.error) return <span class="bad">{job.error.type}</span>;
  if (!job.progress) return <span class="muted">–</span>;
  const { fraction, stage, iteration } = job.progress;
  return (
    <span class="progress">
      {!isFinal(job.status) && <progress value={fraction ?? undefined} max={1} aria-label="Estimate of what is done" />}
      <span class="muted">{isFinal(job.status) ? `${iteration} iterations` : `${stage}, iteration ${iteration}`}</span>
    </span>
  );
}
