// What the wavelets saw: the size of each coefficient, at its level and its time.
import { max } from "d3-array";
import { scaleLinear } from "d3-scale";
import { useRef } from "preact/hooks";
import { number } from "./format";
import { Section } from "./parts";
import { useWidth } from "./plot";
import type { Result } from "./types";

const ROW = 15;
const LEFT = 34;
const RIGHT = 64;
/** Cells of a level that are finer than this are shown together, by the largest of them. */
const FINEST = 512;
const DECADES = 8;

type Coefficients = NonNullable<Result["coefficients"]>;

interface Cell {
  from: number;
  until: number;
  size: number;
}

export interface Level {
  name: string;
  cells: Cell[];
  largest: number;
}

/** The coefficients of one quantity, by level; times relative to the whole, from 0 to 1. Empty without wavelets. */
export function levelsOf({ basis }: Coefficients, values: number[]): Level[] {
  if (!basis.order?.includes("V0")) return [];
  const coarse = basis.L ? basis.L + 3 : (basis.scaling_functions ?? values.length);
  // Wavelets of level 0; each level has twice as many as the one before it.
  const units = basis.L ?? (values.length - coarse) / (2 ** (basis.order.length - 1) - 1);
  let start = 0;
  return basis.order.map((name, index) => {
    const level = index - 1;
    const places = level < 0 ? coarse : units * 2 ** level;
    const active = level < 0 ? undefined : basis.active?.[level];
    const count = active?.length ?? places;
    const sizes = values.slice(start, start + count).map(Math.abs);
    start += count;
    return { name, cells: together(sizes, active, places), largest: max(sizes) ?? 0 };
  });
}

function together(sizes: number[], active: number[] | undefined, places: number): Cell[] {
  const step = Math.max(1, places / FINEST);
  const cells = new Map<number, Cell>();
  for (const [index, size] of sizes.entries()) {
    const place = Math.floor((active?.[index] ?? index) / step);
    const known = cells.get(place);
    if (known) known.size = Math.max(known.size, size);
    else cells.set(place, { from: (place * step) / places, until: ((place + 1) * step) / places, size });
  }
  return [...cells.values()];
}

export function Wavelets({ result }: { result: Result }) {
  const { coefficients } = result;
  if (!coefficients) return null;
  // Of Daubechies' functions only controls consist.
  const states = coefficients.basis.L ? coefficients.states : {};
  const pictures = [states, coefficients.controls].flatMap((group) =>
    Object.entries(group ?? {}).map(([name, values]) => ({ name, levels: levelsOf(coefficients, values) })),
  );
  const shown = pictures.filter(({ levels }) => levels.length > 0);
  if (shown.length === 0) return null;
  const { t } = result.trajectory;
  return (
    <Section title="What the wavelets saw" id="wavelets">
      <p class="note">
        Each cell is a coefficient: its level from coarse (V0) to fine, its place in time, the darker the larger, over{" "}
        {DECADES} decades. Fine levels light up where something happens fast. Beside each level stands its largest one.
      </p>
      <div class="plots">
        {shown.map(({ name, levels }) => (
          <Picture key={name} name={name} levels={levels} from={t[0] ?? 0} until={t.at(-1) ?? 1} />
        ))}
      </div>
    </Section>
  );
}

function Picture({ name, levels, from, until }: { name: string; levels: Level[]; from: number; until: number }) {
  const box = useRef<HTMLElement>(null);
  const width = useWidth(box);
  const largest = max(levels, (level) => level.largest) || 1;
  const x = scaleLinear().domain([0, 1]).range([LEFT, Math.max(LEFT, width - RIGHT)]);
  const time = scaleLinear().domain([from, until]).range(x.range());
  const strength = (size: number) => Math.max(0, 1 + Math.log10(size / largest) / DECADES);
  const bottom = levels.length * ROW;
  const words = levels.map((level) => `${level.name} ${number(level.largest, 2)}`).join(", ");
  return (
    <figure ref={box} class="plot wavelets" data-name={name}>
      <figcaption><span class="plot-name">{name}</span></figcaption>
      <svg width={width} height={bottom + 18} role="img" aria-label={`Largest coefficient of ${name} on each level: ${words}`}>
        {levels.map((level, row) => (
          <g key={level.name} transform={`translate(0,${row * ROW})`} data-level={level.name}>
            <text x={LEFT - 6} y={ROW - 4} text-anchor="end">{level.name}</text>
            <rect class="ground" x={LEFT} width={Math.max(0, width - LEFT - RIGHT)} height={ROW - 1} />
            {level.cells.map((cell) => (
              <rect
                key={cell.from}
                class="cell"
                x={x(cell.from)}
                width={Math.max(0.7, x(cell.until) - x(cell.from))}
                height={ROW - 1}
                fill-opacity={strength(cell.size).toFixed(3)}
              />
            ))}
            <text x={width - RIGHT + 6} y={ROW - 4}>{number(level.largest, 2)}</text>
          </g>
        ))}
        {time.ticks(6).map((tick) => (
          <text key={tick} x={time(tick)} y={bottom + 13} text-anchor="middle">{time.tickFormat(6)(tick)}</text>
        ))}
      </svg>
    </figure>
  );
}
