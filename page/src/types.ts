// The shapes of answers, as far as the page reads them; /openapi.json describes them in full.
export interface Job {
  id: string;
  name: string | null;
  tags: string[];
  status: string;
  method: string;
  created_at: string;
  started_at: string | null;
  finished_at: string | null;
  progress: Progress | null;
  error: { type: string; title: string; detail: string } | null;
  attempts: number;
  cancel_requested: boolean;
  reused_from: string | null;
  sweep: string | null;
  flights_of: string | null;
}

export interface Progress {
  stage: string;
  iteration: number;
  objective: number | null;
  infeasibility: number | null;
  fraction: number | null;
}

export interface StatusEvent {
  status: string;
  attempts: number;
  cancel_requested: boolean;
  error: Job["error"];
  at: string;
}

/** Iteration, objective, infeasibility. */
export type Iterate = [number, number | null, number | null];

/** `iterates`: those since the last event, each with its stage. */
export interface ProgressEvent extends Progress {
  iterates?: [string, ...Iterate][];
  trajectory?: Trajectory;
}

export type Numbers = (number | null)[];

export interface Trajectory {
  t: number[];
  states?: Record<string, Numbers>;
  controls?: Record<string, Numbers>;
  outputs?: Record<string, Numbers> | null;
}

export interface Check {
  name: string;
  value: number | null;
  limit: number | null;
  passed: boolean;
}

export interface Verification {
  integrator?: string;
  rtol?: number;
  passed: boolean;
  note?: string;
  checks: Check[];
  states?: Record<string, Record<"terminal_error" | "max_error" | "at" | "tolerance", number | null>>;
}

/** What was not computed is null, and what a method does not have is not there. */
export interface Result {
  success: boolean;
  status: string;
  message: string;
  objective: number | null;
  final_time: number | null;
  method: Record<string, unknown> & { name: string };
  coefficients?: {
    basis: { name: string; L?: number; order?: string[]; active?: number[][]; scaling_functions?: number };
    states?: Record<string, number[]>;
    controls?: Record<string, number[]>;
  };
  nodes?: { t: number[]; costates?: Record<string, Numbers> | null };
  trajectory: Trajectory;
  outputs?: { name: string; units: string | null }[] | null;
  switching: Record<string, { times: number[]; levels: (number | null)[]; arcs: string[] }>;
  verification: Verification;
  scenarios?: Record<string, { trajectory: Trajectory; verification: Verification }> | null;
  statistics: { variables?: number; constraints?: number; iterations?: number | null; seconds: { total: number } };
  convergence?: { stage?: string; iterates?: Iterate[] }[] | null;
  constraints?: Constraint[] | null;
  warnings?: { code: string; pointer: string; detail: string }[] | null;
  diagnosis?: { pointer: string; name: string; violation: number | null; at: number | null }[] | null;
  provenance?: { versions: Record<string, string>; linear_solver?: string | null } | null;
  resolved?: { document: { problem: { units?: Record<string, string> } } };
}

export interface Constraint {
  pointer: string;
  /** Missing in results of before. */
  name?: string;
  min: number | null;
  max: number | null;
  bounds: [number | null, number | null];
  margin: number | null;
  at: number | null;
  active: [number, number][];
}

/** How a number is spread over flights; `percentiles` by their share, "5" for 5 %. */
export interface Spread {
  nominal: number | null;
  max: number | null;
  percentiles: Record<string, number | null>;
}

/** The result of flights of an answer. */
export interface Flights {
  kind: "flights";
  flights_of: string;
  message: string;
  runs: number;
  lost: number;
  final: Record<string, Spread>;
  residual?: Record<string, Spread> | null;
  violations: (Spread & { pointer: string; rate: number })[];
  worst: {
    run: number;
    lost: boolean;
    limit: string | null;
    tolerances: number | null;
    parameters: Record<string, number>;
    initial_state: Record<string, number>;
  }[];
  columns: Record<string, Numbers>;
}

export interface SweepRow {
  index: number;
  point: Record<string, unknown>;
  job: string;
  status: string;
  error: string | null;
  objective: number | null;
  final_time: number | null;
  verification: { passed: boolean; max_state_error: number | null } | null;
  iterations: number | null;
  seconds: number | null;
}

export interface Sweep {
  id: string;
  name: string | null;
  status: string;
  pointers: string[];
  points: number;
  counts: Record<string, number>;
  created_at: string;
  finished_at: string | null;
  table: SweepRow[] | null;
}

export interface Method {
  name: string;
  title: string;
  defaults: Record<string, unknown>;
}

export interface Case {
  name: string;
  title: string;
  method: string;
}

export type Json = null | boolean | number | string | Json[] | { [key: string]: Json };
