// What the events of a job tell: where it stands, and the iterates on its way.
import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { getJson, isFinal, key, listen } from "./api";
import type { Iterate, Job, Numbers, ProgressEvent, Result, Trajectory } from "./types";

/** Iterates one after another, through all stages; `stages` are where a new one begins. */
export interface History {
  iteration: number[];
  objective: Numbers;
  infeasibility: Numbers;
  stages: { name: string; at: number }[];
}

const NOTHING: History = { iteration: [], objective: [], infeasibility: [], stages: [] };

export interface Watched {
  job: Signal<Job | null>;
  history: Signal<History>;
  /** Where the iterate is, coarsely, for methods that tell. */
  trajectory: Signal<Trajectory | null>;
  error: Signal<Error | null>;
}

/** Follow a job until it ends. */
export function useWatched(id: string): Watched {
  const job = useSignal<Job | null>(null);
  const history = useSignal(NOTHING);
  const trajectory = useSignal<Trajectory | null>(null);
  const error = useSignal<Error | null>(null);
  useEffect(() => {
    let gone = false;
    const look = async () => {
      try {
        const found = await getJson<Job>(`/v1/jobs/${encodeURIComponent(id)}`);
        if (gone) return;
        job.value = found;
        error.value = null;
      } catch (reason) {
        if (!gone) error.value = reason as Error;
      }
    };
    job.value = null;
    history.value = NOTHING;
    trajectory.value = null;
    const stop = listen(id, {
      status: ({ status, attempts }) => {
        if (status === "queued" || status === "running") history.value = NOTHING;
        // What the job says beyond its status is asked for when that changes.
        if (job.value && job.value.status === status && job.value.attempts === attempts) return;
        look();
      },
      progress: (event) => {
        history.value = continued(history.value, event);
        if (event.trajectory) trajectory.value = event.trajectory;
        if (job.value && !isFinal(job.value.status)) job.value = { ...job.value, progress: event };
      },
      lost: (reason) => {
        if (!error.value) error.value = new Error(`The events of the job are not told any more: ${reason}`);
      },
    });
    look();
    return () => {
      gone = true;
      stop();
    };
  }, [id, key.value]);
  return { job, history, trajectory, error };
}

function continued(history: History, { iterates = [] }: ProgressEvent): History {
  return iterates.reduce((known, [stage, ...iterate]) => extended(known, stage, [iterate]), history);
}

/** The history that a result holds: of all its meshes, with more iterates than the events told of. */
export function historyOf(result: Result): History {
  const told = result.convergence?.filter((mesh) => mesh.iterates) ?? [];
  return told.reduce((known, { stage, iterates }) => extended(known, stage ?? "", iterates ?? []), NOTHING);
}

function extended(history: History, stage: string, iterates: Iterate[]): History {
  if (iterates.length === 0) return history;
  // Where a stage counts from the beginning again, the axis goes on.
  const last = history.iteration.at(-1) ?? 0;
  const shift = Math.max(0, last - iterates[0]![0]);
  const at = iterates.map(([iteration]) => iteration + shift);
  const begins = history.stages.at(-1)?.name === stage ? [] : [{ name: stage, at: at[0]! }];
  return {
    iteration: [...history.iteration, ...at],
    objective: [...history.objective, ...iterates.map(([, objective]) => objective)],
    infeasibility: [...history.infeasibility, ...iterates.map(([, , infeasibility]) => infeasibility)],
    stages: [...history.stages, ...begins],
  };
}
