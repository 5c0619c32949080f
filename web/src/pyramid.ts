// SPDX-License-Identifier: Apache-2.0
// Hits and passes in tiles, and coarser levels of them. A cell of level k has the sum of the
// evidence of 2^k x 2^k cells: what `oddsmap resample` makes, so that each level is a map of its own.
// Of a map of probabilities it has that of the most occupied of 2 x 2 where that is rather occupied
// than free, else their mean.

import { nearestNumber } from "./given";
import type { Counts, Payload, PlaneFacts } from "./payload";

export interface Level {
  /** Cells of the map along the side of one of this level. */
  readonly factor: number;
  /** The first tile, counted from the origin of the map, x and y. */
  readonly first: readonly [number, number];
  readonly columns: number;
  readonly rows: number;
  /** For each place, row by row, one more than the number of its tile; 0: no tile is there. */
  readonly table: Uint32Array<ArrayBuffer>;
  readonly tiles: number;
  /** Counts tile by tile, row by row from the lowest y. */
  readonly hits: Counts;
  readonly passes: Counts;
}

export interface Pyramid {
  /** Cells along the side of a tile. */
  readonly tile: number;
  /** Votes in one count. */
  readonly unit: number;
  readonly levels: readonly Level[];
}

/** @param values of a map of probabilities, see `GivenFacts`. */
export async function pyramidOf(payload: Payload<PlaneFacts>, values?: Float64Array): Promise<Pyramid> {
  const { facts } = payload;
  const [coords, hits, passes] = await Promise.all([
    payload.numbers("coords", 4),
    payload.numbers("hits", facts.bytes),
    payload.numbers("passes", facts.bytes),
  ]);
  const first = [facts.first_cell[0] / facts.tile, facts.first_cell[1] / facts.tile] as const;
  let columns = 0;
  let rows = 0;
  for (let i = 0; i < coords.length; i += 2) {
    columns = Math.max(columns, coords[i]! + 1);
    rows = Math.max(rows, coords[i + 1]! + 1);
  }
  const table = new Uint32Array(columns * rows);
  for (let i = 0; i < facts.tiles; i++) table[coords[2 * i + 1]! * columns + coords[2 * i]!] = i + 1;
  const levels: Level[] = [
    { factor: 1, first, columns, rows, table, tiles: facts.tiles, hits, passes },
  ];
  // Two tiles on both sides of the origin stay two, however coarse they get.
  for (let last = levels[0]!; last.columns > 2 || last.rows > 2; levels.push(last)) {
    last = coarser(last, facts.tile, values);
  }
  return { tile: facts.tile, unit: facts.unit, levels };
}

function coarser(fine: Level, tile: number, values?: Float64Array): Level {
  const first = [Math.floor(fine.first[0] / 2), Math.floor(fine.first[1] / 2)] as const;
  const past = [fine.first[0] + fine.columns, fine.first[1] + fine.rows] as const;
  const columns = Math.ceil(past[0] / 2) - first[0];
  const rows = Math.ceil(past[1] / 2) - first[1];
  const table = new Uint32Array(columns * rows);
  let tiles = 0;
  const each = (visit: (from: number, to: number, dx: number, dy: number) => void): void => {
    for (let row = 0; row < fine.rows; row++) {
      for (let column = 0; column < fine.columns; column++) {
        const from = fine.table[row * fine.columns + column]!;
        if (from === 0) continue;
        const x = fine.first[0] + column - 2 * first[0];
        const y = fine.first[1] + row - 2 * first[1];
        visit(from - 1, (y >> 1) * columns + (x >> 1), x & 1, y & 1);
      }
    }
  };
  each((_, place) => {
    if (table[place] === 0) table[place] = ++tiles;
  });
  const added = (counts: Counts): Counts => {
    const sums = emptyFor(4 * largest(counts), tiles * tile * tile);
    each((from, place, dx, dy) => {
      const to = (table[place]! - 1) * tile * tile + (dy * tile * tile + dx * tile) / 2;
      for (let y = 0; y < tile; y++) {
        const source = (from * tile + y) * tile;
        const target = to + (y >> 1) * tile;
        for (let x = 0; x < tile; x++) sums[target + (x >> 1)]! += counts[source + x]!;
      }
    });
    return sums;
  };
  /** Of 2 x 2 numbers of probabilities one. */
  const joined = (numbers: Counts): Counts => {
    const made = numbers instanceof Uint8Array ? new Uint8Array(tiles * tile * tile) : new Uint16Array(tiles * tile * tile);
    each((from, place, dx, dy) => {
      const to = (table[place]! - 1) * tile * tile + (dy * tile * tile + dx * tile) / 2;
      for (let y = 0; y < tile; y += 2) {
        for (let x = 0; x < tile; x += 2) {
          const at = (from * tile + y) * tile + x;
          made[to + (y >> 1) * tile + (x >> 1)] =
            oneOf(values!, [numbers[at]!, numbers[at + 1]!, numbers[at + tile]!, numbers[at + tile + 1]!]);
        }
      }
    });
    return made;
  };
  if (values) {
    const hits = joined(fine.hits);
    return { factor: 2 * fine.factor, first, columns, rows, table, tiles, hits, passes: new Uint8Array(hits.length) };
  }
  const hits = added(fine.hits);
  const passes = added(fine.passes);
  return { factor: 2 * fine.factor, first, columns, rows, table, tiles, hits, passes };
}

function oneOf(values: Float64Array, numbers: readonly number[]): number {
  const most = Math.max(...numbers);
  // Of none that is known, of one that is occupied, of four that are the same.
  if (!(values[most]! < 0.5) || numbers.every((number) => number === most)) return most;
  const known = numbers.filter((number) => number > 0);
  return nearestNumber(values, known.reduce((sum, number) => sum + values[number]!, 0) / known.length);
}

function largest(counts: Counts): number {
  let most = 0;
  for (let i = 0; i < counts.length; i++) if (counts[i]! > most) most = counts[i]!;
  return most;
}

/** The narrowest array that holds such counts. */
function emptyFor(most: number, length: number): Counts {
  if (most < 2 ** 8) return new Uint8Array(length);
  if (most < 2 ** 16) return new Uint16Array(length);
  return most < 2 ** 32 ? new Uint32Array(length) : new Float64Array(length);
}

/** Hits and passes [votes] of a cell of a level, counted from the map's origin. */
export function votesAt(pyramid: Pyramid, level: Level, x: number, y: number): [number, number] {
  const { tile, unit } = pyramid;
  const column = Math.floor(x / tile) - level.first[0];
  const row = Math.floor(y / tile) - level.first[1];
  if (column < 0 || row < 0 || column >= level.columns || row >= level.rows) return [0, 0];
  const number = level.table[row * level.columns + column]!;
  if (number === 0) return [0, 0];
  const within = (y - Math.floor(y / tile) * tile) * tile + (x - Math.floor(x / tile) * tile);
  const at = (number - 1) * tile * tile + within;
  return [level.hits[at]! * unit, level.passes[at]! * unit];
}
