// SPDX-License-Identifier: Apache-2.0
// The voxels of a 3D map that have hits, and how many of them a setting takes for occupied.

import type { Payload, SpaceFacts } from "./payload";
import { valueOf } from "./posterior";
import { isSliced, type Settings } from "./settings";
import { VoxelBlocks } from "./voxel_blocks";

/** Voxels as the graphics card gets them. */
export interface Points {
  readonly count: number;
  /** Three numbers each, from the first cell of the map, and one that fills up. */
  readonly places: Uint16Array<ArrayBuffer>;
  /** Hits and passes of each, in counts: `unit` votes. */
  readonly counts: Uint8Array<ArrayBuffer> | Uint16Array<ArrayBuffer> | Float32Array<ArrayBuffer>;
  readonly unit: number;
}

/** Room for the counts of some voxels. */
export const countsFor = ({ bytes }: SpaceFacts, n: number): Points["counts"] =>
  bytes === 1 ? new Uint8Array(2 * n) : bytes === 2 ? new Uint16Array(2 * n) : new Float32Array(2 * n);

export interface Voxels extends Points {
  /** The pairs of hits and passes that there are [votes], one after the other. */
  readonly pairs: Float64Array;
  /** Of each voxel, which pair it has; of each pair, how many voxels. */
  readonly pairOf: Uint32Array;
  readonly times: Uint32Array;
  readonly mostHits: number;
  readonly blocks: VoxelBlocks;
  /** The box around all of them. */
  readonly box: Clip;
}

export async function voxelsOf(payload: Payload<SpaceFacts>): Promise<Voxels> {
  const { facts } = payload;
  const n = facts.voxels;
  const places = new Uint16Array(4 * n);
  const lo = [Infinity, Infinity, Infinity];
  const hi = [0, 0, 0];
  for (const [axis, name] of ["x", "y", "z"].entries()) {
    const steps = await payload.numbers(name, 2);
    // Sums modulo 65536, which 16 bits are anyway.
    for (let i = 0, at = 0; i < n; i++) {
      places[4 * i + axis] = at = (at + steps[i]!) & 65535;
      if (at < lo[axis]!) lo[axis] = at;
      if (at >= hi[axis]!) hi[axis] = at + 1;
    }
  }
  const hits = await payload.numbers("hits", facts.bytes);
  const passes = await payload.numbers("passes", facts.bytes);
  const counts = countsFor(facts, n);
  const numbers = new Map<number, number>();
  const pairs: number[] = [];
  const times: number[] = [];
  const pairOf = new Uint32Array(n);
  const few = facts.bytes < 4;
  // Two numbers of 32 bits do not fit in one: of those, the second is looked up within the first.
  const within = new Map<number, Map<number, number>>();
  for (let i = 0; i < n; i++) {
    const [h, p] = [hits[i]!, passes[i]!];
    counts[2 * i] = h;
    counts[2 * i + 1] = p;
    let known = numbers;
    if (!few) {
      known = within.get(h) ?? new Map();
      within.set(h, known);
    }
    const key = few ? h * 65536 + p : p;
    let number = known.get(key);
    if (number === undefined) {
      number = times.length;
      known.set(key, number);
      pairs.push(h * facts.unit, p * facts.unit);
      times.push(0);
    }
    pairOf[i] = number;
    times[number]!++;
  }
  let mostHits = 0;
  for (let i = 0; i < pairs.length; i += 2) mostHits = Math.max(mostHits, pairs[i]!);
  const box = { lo, hi };
  return {
    count: n, places, counts, unit: facts.unit, pairs: Float64Array.from(pairs), pairOf,
    times: Uint32Array.from(times), mostHits, blocks: new VoxelBlocks({ count: n, places }, box), box,
  };
}

/** A box of voxels: the first along each axis, and one past the last. */
export interface Clip {
  readonly lo: readonly number[];
  readonly hi: readonly number[];
}

/** The height of the slice, from the first cell of the map; null: there is none. */
export function sliceAt(facts: SpaceFacts, set: Settings): number | null {
  if (!isSliced(set) || !facts.air) return null;
  const height = Math.floor(set.sliceAt / facts.resolution + 1e-6) - facts.lo[2];
  return Math.min(Math.max(height, 0), facts.hi[2] - facts.lo[2] - 1);
}

/** The voxels that are drawn as boxes, or as points: those of the clip box that lie below the slice. */
export function drawnIn(facts: SpaceFacts, set: Settings): Clip {
  const { lo, hi } = clipOf(facts, set);
  return { lo, hi: [hi[0]!, hi[1]!, Math.min(hi[2]!, sliceAt(facts, set) ?? Infinity)] };
}

/** The voxels that the clip box leaves, from the first cell of the map: those with their middle inside. */
export function clipOf(facts: SpaceFacts, set: Settings): Clip {
  const ends = [[set.xLow, set.xHigh], [set.yLow, set.yHigh], [set.zLow, set.zHigh]] as const;
  const first = (metres: number, axis: number): number =>
    Math.min(Math.max(Math.ceil(metres / facts.resolution - 0.5 - 1e-6) - facts.lo[axis]!, 0),
      facts.hi[axis]! - facts.lo[axis]!);
  return { lo: ends.map(([low], axis) => first(low, axis)), hi: ends.map(([, high], axis) => first(high, axis)) };
}

/** Whether a voxel lies in a box. */
export function isInside(clip: Clip, voxels: Pick<Voxels, "places">, i: number): boolean {
  const { lo, hi } = clip;
  const [x, y, z] = [voxels.places[4 * i]!, voxels.places[4 * i + 1]!, voxels.places[4 * i + 2]!];
  return x >= lo[0]! && x < hi[0]! && y >= lo[1]! && y < hi[1]! && z >= lo[2]! && z < hi[2]!;
}

/** Hits and passes of a voxel [votes]. */
export const votesOf = ({ pairs, pairOf }: Pick<Voxels, "pairs" | "pairOf">, i: number): [number, number] =>
  [pairs[2 * pairOf[i]!]!, pairs[2 * pairOf[i]! + 1]!];

/** How many voxels are occupied, in double precision, within a box. */
export function occupiedIn(facts: SpaceFacts, voxels: Voxels, set: Settings, clip: Clip): number {
  const { pairs, pairOf, times } = voxels;
  const occupied = new Uint8Array(times.length);
  let all = 0;
  for (let i = 0; i < times.length; i++) {
    if (valueOf(facts, set, pairs[2 * i]!, pairs[2 * i + 1]!) < set.occupied) continue;
    occupied[i] = 1;
    all += times[i]!;
  }
  if ([0, 1, 2].every((axis) => clip.lo[axis] === 0 && clip.hi[axis] === facts.hi[axis]! - facts.lo[axis]!)) return all;
  let inside = 0;
  for (let i = 0; i < pairOf.length; i++) if (occupied[pairOf[i]!] && isInside(clip, voxels, i)) inside++;
  return inside;
}
