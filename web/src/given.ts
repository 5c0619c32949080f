// SPDX-License-Identifier: Apache-2.0
// Maps of probabilities, as `oddsmap.viewer.given_sheets` packs them: alone, or beside a map of
// counts. In the place of hits stands the number of a probability, in that of passes nothing.

import type { Facts, GivenFacts, Payload } from "./payload";
import { sigmoid } from "./posterior";
import type { PosteriorName } from "./settings";

/** As in `oddsmap.viewer.probability_codes`: places are evenly spaced along p + SLOPE * log odds. */
const PLACES = 65535;
const SLOPE = 1e-3;
const LARGEST = 40;

/** The map of probabilities that a posterior stands for; undefined: it is one of counts. */
export const givenOf = (facts: Facts, name: PosteriorName): GivenFacts | undefined =>
  name.startsWith("given") ? facts.given[Number(name.slice("given".length))] : undefined;

/** What a map of probabilities is called among posteriors. */
export const posteriorOf = (number: number): PosteriorName => `given${number}`;

/** Read what numbers of probabilities stand for. */
async function readGiven(payload: Payload): Promise<void> {
  const even = payload.facts.given.some(({ listed }) => listed === null) ? spaced() : new Float64Array();
  for (const [i, given] of payload.facts.given.entries()) {
    given.values = even;
    if (given.listed === null) continue;
    const halves = [await payload.numbers(`given${i}.low`, 4), await payload.numbers(`given${i}.high`, 4)];
    const words = new Uint32Array(2 * given.listed);
    for (let j = 0; j < given.listed; j++) words.set([halves[0]![j]!, halves[1]![j]!], 2 * j);
    given.values = new Float64Array(given.listed + 1).fill(NaN);
    given.values.set(new Float64Array(words.buffer), 1);
  }
}

/** What is read of each map of the page: the one with counts, if there is one, and the others. */
export type Sheets<T> = ReadonlyMap<string, T>;

/** The one with counts; what free space and slices are known of. */
export const COUNTS = "counts";

/** Which of them a posterior is of. */
export const sheetOf = (name: PosteriorName): string => (name.startsWith("given") ? name : COUNTS);

/** Read each map, of a map of probabilities together with what its numbers stand for. */
export async function sheetsOf<F extends Facts, T>(
  payload: Payload<F>, read: (payload: Payload<F>, values?: Float64Array) => Promise<T>,
): Promise<Sheets<T>> {
  await readGiven(payload);
  const sheets = new Map<string, T>();
  if (payload.facts.counts) sheets.set(COUNTS, await read(payload));
  for (const [i, { values }] of payload.facts.given.entries()) {
    sheets.set(posteriorOf(i), await read(alone(payload, i), values));
  }
  return sheets;
}

/** A map of probabilities as if it were the only one of the page. */
function alone<F extends Facts>(payload: Payload<F>, number: number): Payload<F> {
  const facts = { ...payload.facts, ...payload.facts.given[number], unit: 1 };
  return { facts, numbers: (name, bytes) => payload.numbers(`given${number}.${name}`, bytes) };
}

/** The evenly spaced probabilities, after that of 0, which stands for unknown. */
function spaced(): Float64Array {
  const values = new Float64Array(PLACES + 1).fill(NaN);
  const first = -SLOPE * LARGEST;
  const step = (1 - 2 * first) / (PLACES - 1);
  let logOdds = -LARGEST;
  for (let i = 0; i < PLACES; i++) {
    // From the last one, Newton's method is there at once.
    for (let turn = 0; turn < 6; turn++) {
      const p = sigmoid(logOdds);
      logOdds += (first + i * step - p - SLOPE * logOdds) / (p * sigmoid(-logOdds) + SLOPE);
    }
    values[i + 1] = sigmoid(logOdds);
  }
  return values;
}

/** The number whose probability is the nearest to one. */
export function nearestNumber(values: Float64Array, probability: number): number {
  let below = 1;
  let above = values.length - 1;
  while (above - below > 1) {
    const middle = (below + above) >> 1;
    if (values[middle]! <= probability) below = middle;
    else above = middle;
  }
  return probability - values[below]! <= values[above]! - probability ? below : above;
}
