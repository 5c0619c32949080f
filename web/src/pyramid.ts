// SPDX-License-Identifier: Apache-2.0
// Hits and passes in tiles, and coarser levels of them. A cell of level k has the sum of the
// evidence of 2^k x 2^k cells: what `oddsmap resample` makes, so that each level is a map of its own.

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

export async function pyramidOf(payload: Payload<PlaneFacts>): Promise<Pyramid> {
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
    last = coarser(last, facts.tile);
  }
  return { tile: facts.tile, unit: facts.unit, levels };
}

function coarser(fine: Level, tile: number): Level {
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
  const hits = added(fine.hits);
  const passes = added(fine.passes);
  return { factor: 2 * fine.factor, first, columns, rows, table, tiles, hits, passes };
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
