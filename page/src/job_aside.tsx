// What stands beside the plots of a job: its figures, what a design review asks for, its files.
import { download } from "./api";
import { between, leaf, number, seconds, when } from "./format";
import { Action, type Fact, Facts, Section, WideTable } from "./parts";
import { to } from "./route";
import type { Constraint, Job, Result } from "./types";

export function Summary({ job, result }: { job: Job; result: Result | null }) {
  const link = (path: string, id: string) => <a href={to(`${path}/${id}`)}>{id}</a>;
  const facts: Fact[] = [
    ["method", job.method],
    ...(result ? sizes(result) : []),
    ["submitted", when(job.created_at)],
    ...(job.finished_at ? ([["took", between(job.started_at, job.finished_at)]] satisfies Fact[]) : []),
    ["attempts", job.attempts],
    ["id", <code key="id">{job.id}</code>],
  ];
  if (job.sweep) facts.push(["point of the sweep", link("/sweeps", job.sweep)]);
  if (job.flights_of) facts.push(["flights of", link("/jobs", job.flights_of)]);
  if (job.reused_from) facts.push(["answer of", link("/jobs", job.reused_from)]);
  return (
    <Section title="Job" id="job">
      <Facts facts={facts} />
      <p class="tags">{job.tags.map((tag) => <a key={tag} class="tag" href={to("/", { tag })}>{tag}</a>)}</p>
    </Section>
  );
}

function sizes({ statistics: { variables, constraints, seconds: spent } }: Result): Fact[] {
  return [
    ["variables, constraints", `${variables ?? "–"}, ${constraints ?? "–"}`],
    ["solver's time", seconds(spent.total)],
  ];
}

/** What the design review asks for: margins, warnings, why nothing feasible was found. */
export function Findings({ result }: { result: Result }) {
  const [constraints, warnings, diagnosis] = [result.constraints ?? [], result.warnings ?? [], result.diagnosis ?? []];
  return (
    <>
      {diagnosis.length > 0 && (
        <Section title="No feasible point found" id="diagnosis">
          <ul>
            {diagnosis.map((item) => (
              <li key={item.pointer}>{item.name}: violated by {number(item.violation, 3)} at t = {number(item.at, 4)}</li>
            ))}
          </ul>
        </Section>
      )}
      {constraints.length > 0 && (
        <Section title="Margins" id="margins">
          <WideTable label="Margins of the constraints">
            <thead>
              <tr>
                <th scope="col">Constraint</th>
                <th scope="col" class="right">Least</th>
                <th scope="col" class="right">Greatest</th>
                <th scope="col" class="right">Margin</th>
              </tr>
            </thead>
            <tbody>
              {constraints.map((item) => (
                <tr key={item.pointer}>
                  <th scope="row" title={item.pointer}>{item.name || leaf(item.pointer)}</th>
                  <td class="right">{number(item.min, 4)}</td>
                  <td class="right">{number(item.max, 4)}</td>
                  <td class="right">{marginOf(item)}</td>
                </tr>
              ))}
            </tbody>
          </WideTable>
        </Section>
      )}
      {warnings.length > 0 && (
        <Section title="Warnings" id="warnings">
          <ul>{warnings.map((item) => <li key={item.code + item.pointer}><code>{item.pointer}</code> {item.detail}</li>)}</ul>
        </Section>
      )}
    </>
  );
}

/** How far a constraint is from its bounds; where it rests on one, what is left is only rounding. */
function marginOf({ active, margin, min, max }: Constraint): string {
  const scale = Math.max(Math.abs(min ?? 0), Math.abs(max ?? 0));
  return active.length > 0 && Math.abs(margin ?? 0) < 1e-5 * scale ? "active" : number(margin, 3);
}

export function Downloads({ job, result }: { job: Job; result: boolean }) {
  const base = `/v1/jobs/${job.id}`;
  const numbers: [string, string, string][] = [
    ["JSON", `${base}/result?format=json`, `${job.id}.json`],
    ["CSV", `${base}/result?format=csv`, `${job.id}.csv`],
  ];
  const more: typeof numbers = [
    ["NPZ", `${base}/result?format=npz`, `${job.id}.npz`],
    ["MAT", `${base}/result?format=mat`, `${job.id}.mat`],
    ["SVG", `${base}/plot.svg`, `${job.id}.svg`],
    ["Report", `${base}/report.html`, `${job.id}.html`],
    ["Bundle", `${base}/bundle.zip`, `${job.id}.zip`],
  ];
  // These two tell of a job that has no result as well.
  const always = ["Report", "Bundle"];
  const files = job.flights_of ? numbers : [...numbers, ...more];
  return (
    <Section title="Files" id="files">
      <div class="files">
        {files.map(([label, path, name]) => (
          <Action key={label} act={() => download(path, name)} disabled={!result && !always.includes(label)}>{label}</Action>
        ))}
      </div>
    </Section>
  );
}
