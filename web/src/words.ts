// SPDX-License-Identifier: Apache-2.0
// Numbers and cells in words.

import type { Facts, PlaneFacts } from "./payload";
import { betaInterval } from "./beta";
import { isProbability, LEVEL, stateOf, valueOf } from "./posterior";
import type { Settings } from "./settings";

export const MINUS = "\u2212";

/** A number in few digits, as people write it. */
export function short(value: number, digits = 3): string {
  const text = Math.abs(value) >= 1e5 || (value !== 0 && Math.abs(value) < 1e-6)
    ? value.toExponential(digits - 1)
    : String(Number(value.toPrecision(digits)));
  return text.replace("-", MINUS);
}

/** What a probability is, with as many digits as tell it from 0 and 1. */
export function chance(p: number): string {
  const rest = Math.min(p, 1 - p);
  if (rest < 1e-6) return p < 0.5 ? "below 0.000001" : "above 0.999999";
  return `= ${p.toFixed(Math.min(Math.max(3, 1 - Math.floor(Math.log10(rest))), 7))}`;
}

/** A share, in three digits of what it is or of what it lacks. */
function share(p: number): string {
  const rest = Math.min(p, 1 - p);
  if (rest < 1e-6) return p < 0.5 ? "0" : "1";
  return p < 0.9 ? short(p) : p.toFixed(2 - Math.floor(Math.log10(1 - p)));
}

/** A coordinate [m], to a tenth of a cell. */
export function metres(value: number, resolution: number): string {
  const digits = Math.max(0, Math.ceil(1 - Math.log10(resolution)));
  return value.toFixed(Math.min(digits, 6)).replace("-", MINUS);
}

/** Votes, or how many there are of something: whole where they are. */
export const count = (value: number): string =>
  value.toLocaleString("en", { maximumFractionDigits: value < 100 ? 3 : 1 });

const many = (value: number, word: string, more: string): string =>
  `${count(value)} ${value === 1 ? word : more}`;

/** Which cell something is. */
export const indices = (index: readonly number[]): string =>
  index.map((i) => String(i).replace("-", MINUS)).join(", ");

/** Where and what a cell is. */
export interface Cell {
  readonly x: number;
  readonly y: number;
  /** Cells of the map along its side. */
  readonly factor: number;
  readonly hits: number;
  readonly passes: number;
}

/** What is known of a cell: a line each. */
export function describe(facts: PlaneFacts, set: Settings, cell: Cell): string[] {
  const { hits, passes } = cell;
  const where = cell.factor === 1
    ? `cell ${indices([cell.x, cell.y])}`
    : `${cell.factor} \u00d7 ${cell.factor} cells together, ${short(cell.factor * facts.resolution)} m`;
  return [where, ...describeVotes(facts, set, hits, passes)];
}

/** What is known by some votes: a line each. */
export function describeVotes(facts: Facts, set: Settings, hits: number, passes: number): string[] {
  const seen = hits > 0 || passes > 0;
  if (!seen) return ["unknown: no beam was here"];
  const lines = [`${many(hits, "hit", "hits")}, ${many(passes, "pass", "passes")}`];
  if (isProbability(set.posterior)) {
    const p = valueOf(facts, set, hits, passes);
    lines.push(`${stateOf(set, p, seen)}, p ${chance(p)}`);
  }
  const fitted = set.posterior === "calibrated" ? facts.calibrated?.beta : undefined;
  const alpha = (fitted?.[0] ?? set.betaA) + hits;
  const beta = (fitted?.[1] ?? set.betaB) + passes;
  const [low, high] = betaInterval(alpha, beta, LEVEL);
  lines.push(
    `reflectivity ${share(alpha / (alpha + beta))}, ${100 * LEVEL} % interval ${share(low)} to ${share(high)}`,
  );
  return lines;
}
