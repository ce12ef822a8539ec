// Whether the answer is what it says: in words and colours, with the numbers.
import { number } from "./format";
import { Facts, Section, WideTable } from "./parts";
import type { Check, Result } from "./types";

/** The verdict and the figures, in one line. */
export function Headline({ result }: { result: Result }) {
  const { success, objective, final_time, statistics } = result;
  return (
    <div class="headline">
      <p class={`verdict ${success ? "good" : "bad"}`}>
        <span aria-hidden="true">{success ? "✓" : "✕"}</span> {verdict(result)}
      </p>
      <Facts
        strip
        facts={[
          ["objective", <b key="objective">{number(objective, 9)}</b>],
          ["final time", number(final_time, 9)],
          ["iterations", statistics.iterations ?? "–"],
        ]}
      />
    </div>
  );
}

export function Verified({ result }: { result: Result }) {
  const { verification } = result;
  const states = Object.entries(verification.states ?? {});
  // Of a failed job, the message stands above everything already.
  const remarks = [result.success ? result.message : "", verification.note ?? ""].join(" ").trim();
  return (
    <Section title="Verification" id="verification">
      {remarks && <p class="note">{remarks}</p>}
      {verification.checks.length > 0 && <Checks checks={verification.checks} />}
      {states.length > 0 && (
        <WideTable label="Errors of each state">
          <caption>Errors of each state, in its own unit</caption>
          <thead>
            <tr>
              <th scope="col">State</th>
              <th scope="col" class="right">At the end</th>
              <th scope="col" class="right">Largest</th>
              <th scope="col" class="right">at t</th>
              <th scope="col" class="right">Allowed</th>
            </tr>
          </thead>
          <tbody>
            {states.map(([name, found]) => (
              <tr key={name}>
                <th scope="row">{name}</th>
                <td class="right">{number(found.terminal_error, 3)}</td>
                <td class="right">{number(found.max_error, 3)}</td>
                <td class="right">{number(found.at, 4)}</td>
                <td class="right">{number(found.tolerance, 3)}</td>
              </tr>
            ))}
          </tbody>
        </WideTable>
      )}
    </Section>
  );
}

function verdict({ success, verification }: Result): string {
  const failed = verification.checks.filter((check) => !check.passed);
  const flown = verification.integrator
    ? `Flown with the original model (${verification.integrator}, tolerance ${number(verification.rtol, 1)}), `
    : "";
  const count = verification.checks.length;
  if (success) return `Verified. ${flown}the answer passed all ${count} checks.`;
  if (failed.length === 0) return "Not verified: the program did not converge.";
  return `Not verified. ${flown}the answer failed ${failed.length} of ${count} checks.`;
}

function Checks({ checks }: { checks: Check[] }) {
  return (
    <table class="checks">
      <caption>Checks, relative to the scale of each quantity</caption>
      <thead>
        <tr>
          <th scope="col">Check</th>
          <th scope="col" class="right">Value</th>
          <th scope="col" class="right">Limit</th>
          <th scope="col">Outcome</th>
        </tr>
      </thead>
      <tbody>
        {checks.map((check) => (
          <tr key={check.name}>
            <th scope="row">{check.name.replaceAll("_", " ")}</th>
            <td class="right">{number(check.value, 3)}</td>
            <td class="right">{number(check.limit, 3)}</td>
            <td class={check.passed ? "good" : "bad"}>{check.passed ? "✓ passed" : "✕ failed"}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
