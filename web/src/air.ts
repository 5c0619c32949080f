// SPDX-License-Identifier: Apache-2.0
// The voxels of a 3D map without hits. They are packed in slabs of heights, see `oddsmap.viewer.air`,
// and unpacked when they are asked for.

import type { Counts, Payload, SpaceFacts } from "./payload";
import { VoxelBlocks } from "./voxel_blocks";
import { countsFor, type Points, type Voxels, votesOf } from "./voxels";

/** Free space is drawn where it has no more voxels: each takes 10 bytes and more. */
export const MOST_DRAWN = 1 << 24;

/** Voxels without hits that a map has. */
export const airOf = (facts: SpaceFacts): number => facts.cells - facts.voxels;

interface Slab {
  readonly rows: Counts;
  readonly gaps: Counts;
  readonly lengths: Counts;
  readonly passes: Counts;
}

/** All voxels without hits. */
export async function wholeAir(payload: Payload<SpaceFacts>): Promise<Points> {
  const { facts } = payload;
  const n = airOf(facts);
  const places = new Uint16Array(4 * n);
  const counts = countsFor(facts, n);
  let at = 0;
  for (const number of facts.air?.slabs ?? []) {
    eachOf(facts, number, await slabOf(payload, number), (x, y, z, passes) => {
      places[4 * at] = x;
      places[4 * at + 1] = y;
      places[4 * at + 2] = z;
      counts[2 * at++ + 1] = passes;
    });
  }
  return { count: n, places, counts, unit: facts.unit };
}

/** A horizontal slice: all voxels of one height that have evidence. */
export interface Slice extends Points {
  /** Counted from the first cell of the map, as places are. */
  readonly height: number;
  /** Hits and passes of each [votes]. */
  readonly votes: Float64Array;
  readonly blocks: VoxelBlocks;
}

export async function sliceOf(payload: Payload<SpaceFacts>, voxels: Voxels, height: number): Promise<Slice> {
  const { facts } = payload;
  const places: number[] = [];
  const votes: number[] = [];
  for (let i = 0; i < voxels.count; i++) {
    if (voxels.places[4 * i + 2] !== height) continue;
    places.push(voxels.places[4 * i]!, voxels.places[4 * i + 1]!, height, 0);
    votes.push(...votesOf(voxels, i));
  }
  const number = Math.floor(height / (facts.air?.heights ?? 1));
  if (facts.air?.slabs.includes(number)) {
    eachOf(facts, number, await slabOf(payload, number), (x, y, z, passes) => {
      if (z !== height) return;
      places.push(x, y, z, 0);
      votes.push(0, passes * facts.unit);
    });
  }
  const points = { count: votes.length / 2, places: new Uint16Array(places) };
  const box = {
    lo: [0, 0, height], hi: [facts.hi[0] - facts.lo[0], facts.hi[1] - facts.lo[1], height + 1],
  };
  return {
    ...points, height, votes: new Float64Array(votes), counts: new Float32Array(votes), unit: 1,
    blocks: new VoxelBlocks(points, box),
  };
}

async function slabOf(payload: Payload<SpaceFacts>, number: number): Promise<Slab> {
  const [rows, gaps, lengths, passes] = await Promise.all(
    ([["rows", 4], ["gaps", 2], ["lengths", 2], ["passes", payload.facts.bytes]] as const)
      .map(([name, bytes]) => payload.numbers(`air.${number}.${name}`, bytes)),
  );
  return { rows: rows!, gaps: gaps!, lengths: lengths!, passes: passes! };
}

/** Tell of each voxel of a slab where it is and what passes it has, in counts. */
function eachOf(
  facts: SpaceFacts, number: number, { rows, gaps, lengths, passes }: Slab,
  visit: (x: number, y: number, z: number, passes: number) => void,
): void {
  const across = facts.hi[1] - facts.lo[1];
  const first = number * (facts.air?.heights ?? 1);
  let row = 0;
  let x = 0;
  let at = 0;
  for (let run = 0; run < rows.length; run++) {
    row += rows[run]!;
    x = (x + gaps[run]!) & 65535;
    const z = first + Math.floor(row / across);
    const y = row % across;
    for (let end = x + lengths[run]! + 1; x < end; x++) visit(x, y, z, passes[at++]!);
  }
}
