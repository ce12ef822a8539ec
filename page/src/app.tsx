// The page: its head, and the view that the address names.
import { render } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { Compare } from "./compare";
import { JobPage } from "./job";
import { Jobs } from "./jobs";
import { KeyButton } from "./key";
import { NewJob } from "./new";
import { type Route, route, to } from "./route";
import { SweepPage } from "./sweep";

function View({ path, query }: Route) {
  const [group, id] = path;
  if (group === undefined) return <Jobs />;
  if (group === "jobs" && id) return <JobPage key={id} id={id} />;
  if (group === "sweeps" && id) return <SweepPage key={id} id={id} />;
  if (group === "compare") return <Compare jobs={(query.get("jobs") ?? "").split(",").filter(Boolean)} />;
  if (group === "new") return <NewJob />;
  return <h1 tabIndex={-1}>There is nothing here.</h1>;
}

function App() {
  const here = route.value;
  const view = here.path.join("/");
  const first = useRef(true);
  useEffect(() => {
    document.title = "ondelette";
    scrollTo(0, 0);
    // Whoever does not see the page is told where he has come.
    if (!first.current) document.querySelector<HTMLElement>("main h1")?.focus({ preventScroll: true });
    first.current = false;
  }, [view]);
  const entry = (path: string, label: string, group: string | undefined) => (
    <a href={to(path)} aria-current={here.path[0] === group ? "page" : undefined}>{label}</a>
  );
  return (
    <>
      <a class="skip" href="#main" onClick={(event) => { event.preventDefault(); document.querySelector<HTMLElement>("main h1")?.focus(); }}>
        Skip to the content
      </a>
      <header class="top">
        <a class="brand" href={to("/")}>
          <svg viewBox="0 0 32 32" width="22" height="22" aria-hidden="true">
            <path d="M2 16h5c2.5 0 2.5-5 4.5-5s2 17 4.5 17 2.5-24 4.5-24 2 12 4.5 12h5" />
          </svg>
          ondelette
        </a>
        <nav aria-label="Views">
          {entry("/", "Jobs", undefined)}
          {entry("/new", "New job", "new")}
          <a href="/docs">API</a>
        </nav>
        <KeyButton />
      </header>
      <main id="main">
        <View {...here} />
      </main>
    </>
  );
}

render(<App />, document.getElementById("app")!);
