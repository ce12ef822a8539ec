// What is asked of the service while a part of the page is shown.
import { type Signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { key } from "./api";

export interface Loaded<T> {
  data: Signal<T | null>;
  error: Signal<Error | null>;
}

/** Ask anew whenever `dependencies` or the key change; an answer that comes too late is thrown away. */
export function useLoaded<T>(ask: (signal: AbortSignal) => Promise<T>, dependencies: unknown[]): Loaded<T> {
  const data = useSignal<T | null>(null);
  const error = useSignal<Error | null>(null);
  useEffect(() => {
    const controller = new AbortController();
    ask(controller.signal).then(
      (answer) => {
        if (controller.signal.aborted) return;
        data.value = answer;
        error.value = null;
      },
      (reason: Error) => {
        if (!controller.signal.aborted) error.value = reason;
      },
    );
    return () => controller.abort();
  }, [...dependencies, key.value]);
  return { data, error };
}

/** Do `step` again and again, `pause()` milliseconds after it has ended, while the page can be seen. */
export function usePolling(step: () => Promise<void>, pause: () => number | null, dependencies: unknown[]): void {
  useEffect(() => {
    let timer = 0;
    let stopped = false;
    const next = async () => {
      if (!document.hidden) await step();
      const wait = pause();
      if (!stopped && wait !== null) timer = window.setTimeout(next, wait);
    };
    next();
    return () => {
      stopped = true;
      clearTimeout(timer);
    };
  }, [...dependencies, key.value]);
}
