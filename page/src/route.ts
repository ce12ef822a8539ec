// Where one is, as the part of the address behind #: `#/jobs/ID?with=OTHER`. The service serves one page.
import { computed, signal } from "@preact/signals";

const address = signal(location.hash);
addEventListener("hashchange", () => {
  address.value = location.hash;
});

export interface Route {
  path: string[];
  query: URLSearchParams;
}

export const route = computed<Route>(() => {
  const [path = "", query = ""] = address.value.replace(/^#\/?/, "").split("?", 2);
  return { path: path.split("/").filter(Boolean).map(decodeURIComponent), query: new URLSearchParams(query) };
});

/** The address of a view; parameters that are empty are left out. */
export function to(path: string, query: Record<string, string | undefined> = {}): string {
  const given = Object.entries(query).filter((entry): entry is [string, string] => Boolean(entry[1]));
  return `#${path}${given.length ? `?${new URLSearchParams(given)}` : ""}`;
}

export function go(target: string): void {
  location.hash = target;
}
