// What the page asks the service, and how a refusal (RFC 9457) comes back.
import { effect, signal } from "@preact/signals";
import { EventSource } from "eventsource";
import type { ProgressEvent, StatusEvent } from "./types";

const REMEMBERED = "ondelette.key";

/** The API key, kept as long as this tab is open; empty where the operator asks for none. */
export const key = signal(sessionStorage.getItem(REMEMBERED) ?? "");
effect(() => {
  if (key.value) sessionStorage.setItem(REMEMBERED, key.value);
  else sessionStorage.removeItem(REMEMBERED);
});

/** True from the moment at which the service asked for a key until there is another one. */
export const keyWanted = signal(false);

/** A mistake of a document, at a JSON pointer, or of a parameter of a request. */
export interface Fault {
  pointer?: string;
  parameter?: string;
  detail: string;
}

export class Refusal extends Error {
  constructor(
    readonly status: number,
    readonly type: string,
    title: string,
    readonly detail: string,
    readonly faults: Fault[],
  ) {
    super(detail ? `${title}: ${detail}` : title);
  }
}

/** Whether the service asks for a key, or for another one. */
export function refused(error: Error | null): boolean {
  return error instanceof Refusal && error.status === 401;
}

function headersOf(init?: RequestInit): Headers {
  const headers = new Headers(init?.headers);
  if (key.value) headers.set("Authorization", `Bearer ${key.value}`);
  return headers;
}

/** Ask the service; throws a Refusal for every answer that is one. */
export async function request(path: string, init?: RequestInit): Promise<Response> {
  const answer = await fetch(path, { ...init, headers: headersOf(init) });
  if (answer.ok) return answer;
  if (answer.status === 401) keyWanted.value = true;
  const problem = await answer.json().catch(() => ({}));
  throw new Refusal(
    answer.status,
    problem.type ?? "",
    problem.title ?? `HTTP status ${answer.status}`,
    problem.detail ?? "",
    problem.errors ?? [],
  );
}

export async function getJson<T>(path: string, signal?: AbortSignal): Promise<T> {
  return (await request(path, { signal, headers: { Accept: "application/json" } })).json();
}

export async function post<T>(path: string, body?: string, signal?: AbortSignal): Promise<T> {
  const headers = { "Content-Type": "application/json" };
  return (await request(path, { method: "POST", body, headers, signal })).json();
}

/** Save a file of the service under its own name. Not a plain link, for a key may have to go with it. */
export async function download(path: string, name: string): Promise<void> {
  const address = URL.createObjectURL(await (await request(path)).blob());
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
  // Not at once: the browser reads it after the click.
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

/** Hear what happens to a job, from its beginning on; returns how to stop listening. */
export function listen(
  job: string,
  heard: { status(event: StatusEvent): void; progress(event: ProgressEvent): void; lost(reason: string): void },
): () => void {
  const source = new EventSource(`/v1/jobs/${encodeURIComponent(job)}/events`, {
    fetch: (input, init) => fetch(input, { ...init, headers: headersOf(init as RequestInit) }),
  });
  source.addEventListener("status", (event) => {
    const told: StatusEvent = JSON.parse(event.data);
    heard.status(told);
    if (isFinal(told.status)) source.close();
  });
  source.addEventListener("progress", (event) => heard.progress(JSON.parse(event.data)));
  source.onerror = (event) => {
    // The library connects again by itself, unless it was told that nothing follows.
    if (source.readyState === EventSource.CLOSED && event.code !== 204) heard.lost(event.message ?? "refused");
  };
  return () => source.close();
}

export function isFinal(status: string): boolean {
  return status === "succeeded" || status === "failed" || status === "cancelled";
}
