// Flights of an answer: how often which limit was missed, how everything is spread, which were the worst.
import { useSignal } from "@preact/signals";
import { useMemo } from "preact/hooks";
import { leaf, number } from "./format";
import { Facts, Section, WideTable } from "./parts";
import { Plot } from "./plot";
import { ZoomButtons } from "./plot_cursor";
import type { Axis, Curve } from "./plot_frame";
import { to } from "./route";
import type { Flights, Numbers, Spread } from "./types";

/** The verdict and the figures, in one line. */
export function FlightsHeadline({ flights }: { flights: Flights }) {
  const clean = flights.lost === 0 && flights.violations.every(({ rate }) => rate === 0);
  return (
    <div class="headline">
      <p class={`verdict ${clean ? "good" : "bad"}`}>
        <span aria-hidden="true">{clean ? "✓" : "✕"}</span> {flights.message}
      </p>
      <Facts
        strip
        facts={[
          ["flights", flights.runs],
          ["lost", flights.lost],
          ["of the answer", <a key="answer" href={to(`/jobs/${flights.flights_of}`)}>{flights.flights_of}</a>],
        ]}
      />
    </div>
  );
}

export function FlightsAnswer({ flights }: { flights: Flights }) {
  return (
    <>
      <Section title="Limits, and by how much they are missed" id="limits">
        <Spreads
          label="Misses of each limit"
          rows={flights.violations.map((item) => [leaf(item.pointer), item.pointer, item])}
          rate={(index) => `${number(100 * flights.violations[index]!.rate, 3)} %`}
        />
      </Section>
      <Distributions columns={flights.columns} />
      <Section title="At the end" id="final">
        <Spreads label="Final states" rows={named(flights.final)} />
      </Section>
      {flights.residual && (
        <Section title="Coasting: amplitudes" id="residual">
          <Spreads label="Residual amplitudes" rows={named(flights.residual)} />
        </Section>
      )}
      <Worst flights={flights} />
    </>
  );
}

function named(spreads: Record<string, Spread>): [string, string, Spread][] {
  return Object.entries(spreads).map(([name, spread]) => [name, name, spread]);
}

function Spreads(props: { label: string; rows: [string, string, Spread][]; rate?: (index: number) => string }) {
  const { label, rows, rate } = props;
  const heads = [...(rate ? ["Violated"] : []), "Nominal", "5 %", "50 %", "95 %", "Max"];
  return (
    <WideTable label={label}>
      <thead>
        <tr>
          <th scope="col">Name</th>
          {heads.map((head) => <th key={head} scope="col" class="right">{head}</th>)}
        </tr>
      </thead>
      <tbody>
        {rows.map(([name, title, { nominal, percentiles, max }], index) => (
          <tr key={title}>
            <th scope="row" title={title}>{name}</th>
            {rate && <td class="right">{rate(index)}</td>}
            {[nominal, percentiles["5"], percentiles["50"], percentiles["95"], max].map((value, column) => (
              <td key={heads[column]} class="right">{number(value, 4)}</td>
            ))}
          </tr>
        ))}
      </tbody>
    </WideTable>
  );
}

/** What every quantity is below of, over the share of flights: its distribution, which can be read off. */
function Distributions({ columns }: { columns: Record<string, Numbers> }) {
  const window = useSignal<[number, number] | null>(null);
  const cursor = useSignal<number | null>(null);
  const axis: Axis = { label: "share of flights [%]", domain: [0, 100], window, cursor };
  const curves = useMemo(() => Object.entries(columns).flatMap(distribution), [columns]);
  return (
    <Section title="Distributions" id="distributions" aside={<ZoomButtons axis={axis} />}>
      <div class="plots">
        {curves.map((curve) => <Plot key={curve.name} name={curve.name} axis={axis} curves={[curve]} />)}
      </div>
    </Section>
  );
}

/** The sorted values; nothing of limits, which have a table, and of what is the same for all flights. */
function distribution([name, values]: [string, Numbers]): Curve[] {
  const y = values.filter((value) => value !== null).sort((a, b) => a - b);
  const spread = y.length > 1 && y.at(-1)! - y[0]! > 1e-12 * Math.abs(y.at(-1)!);
  if (name.startsWith("/") || !spread) return [];
  return [{ name, x: y.map((_, index) => (100 * (index + 0.5)) / y.length), y }];
}

function Worst({ flights: { worst } }: { flights: Flights }) {
  const drawn = [...new Set(worst.flatMap(({ parameters, initial_state }) => Object.keys({ ...parameters, ...initial_state })))];
  if (worst.length === 0) return null;
  return (
    <Section title="Worst flights" id="worst">
      <WideTable label="Worst flights">
        <thead>
          <tr>
            <th scope="col">Flight</th>
            <th scope="col">Limit</th>
            <th scope="col" class="right">Tolerances</th>
            {drawn.map((name) => <th key={name} scope="col" class="right">{name}</th>)}
          </tr>
        </thead>
        <tbody>
          {worst.map((flight) => (
            <tr key={flight.run}>
              <th scope="row">{flight.run}</th>
              <td title={flight.limit ?? ""}>{flight.lost ? "lost" : leaf(flight.limit ?? "–")}</td>
              <td class="right">{number(flight.tolerances, 3)}</td>
              {drawn.map((name) => (
                <td key={name} class="right">{number(flight.parameters[name] ?? flight.initial_state[name], 6)}</td>
              ))}
            </tr>
          ))}
        </tbody>
      </WideTable>
    </Section>
  );
}
