// SPDX-License-Identifier: Apache-2.0
// The way of a log's sensors, as `oddsmap.viewer.journey_payload` packs it; all in metres of the map.

import type { Counts } from "./payload";

export interface JourneyFacts {
  log: string;
  scans: number;
  axes: 2 | 3;
  sensors: string[];
  lo: number[];
  unit: number;
  time_unit: number;
  first_stamp: string | null;
  /** Whether some beams of each scan are here; else a server is asked for them. */
  kept: boolean;
  reach_unit: number;
  served: boolean;
  /** The command that makes the map, where it is in no file. */
  build: string | null;
  /** The words that ask about a cell in a terminal: before the point, and after it. */
  why: string[];
  options: string[];
}

export interface JourneyPayload {
  facts: JourneyFacts;
  numbers(name: string, bytes: 1 | 2 | 4): Promise<Counts>;
}

/** Some beams of a scan; three coordinates for each start and end. */
export interface Beams {
  readonly starts: ArrayLike<number>;
  readonly ends: ArrayLike<number>;
  readonly returned: ArrayLike<number>;
  /** Beams of the whole scan, and how many of them say nothing. */
  readonly readings: number;
  readonly silent: number;
}

export interface Place {
  readonly x: number;
  readonly y: number;
  readonly z: number;
  /** Where the sensor looks [rad]. */
  readonly yaw: number;
  readonly pitch: number;
}

export interface Journey {
  readonly facts: JourneyFacts;
  /** Where a scan was taken; null: its pose is none. */
  at(scan: number): Place | null;
  /** Seconds since the first stamp; null: the scan has none. */
  time(scan: number): number | null;
  /** The scans of each sensor, in order. */
  readonly ways: readonly Uint32Array[];
  sensor(scan: number): string;
  /** The beams that are kept of a scan; null: none are. */
  beams(scan: number): Beams | null;
}

const TURN = (2 * Math.PI) / 65536;

export async function journeyOf(payload: JourneyPayload): Promise<Journey> {
  const { facts } = payload;
  const n = facts.scans;
  const space = facts.axes === 3;
  const places = await Promise.all(["x", "y", "z"].slice(0, facts.axes).map(
    async (name, axis) => summed(await payload.numbers(name, 4), facts.unit, facts.lo[axis]!),
  ));
  const known = await payload.numbers("known", 1);
  const stamped = await payload.numbers("stamped", 1);
  const times = summed(await payload.numbers("time", 4), facts.time_unit, 0);
  const whose = await payload.numbers("whose", 4);
  const yaw = await payload.numbers("yaw", 2);
  const pitch = await payload.numbers("pitch", 2);
  const ways: number[][] = facts.sensors.map(() => []);
  for (let i = 0; i < n; i++) ways[whose[i]!]!.push(i);
  const at = (i: number): Place | null => known[i] ? {
    x: places[0]![i]!, y: places[1]![i]!, z: places[2]?.[i] ?? 0,
    yaw: signed(yaw[i]!), pitch: signed(pitch[i]!),
  } : null;
  return {
    facts, at,
    ways: ways.map((way) => Uint32Array.from(way)),
    time: (i) => (stamped[i] ? times[i]! : null),
    sensor: (i) => facts.sensors[whose[i]!]!,
    beams: facts.kept ? await keptBeams(payload, at, space) : () => null,
  };
}

/** Steps from number to number, modulo 2^32, as the numbers. */
function summed(steps: Counts, unit: number, lo: number): Float64Array {
  const values = new Float64Array(steps.length);
  for (let i = 0, at = 0; i < steps.length; i++) values[i] = lo + unit * (at = (at + steps[i]!) >>> 0);
  return values;
}

/** An angle of up to half a turn, either way. */
const signed = (turns: number): number => TURN * (turns < 32768 ? turns : turns - 65536);

async function keptBeams(
  payload: JourneyPayload, at: (scan: number) => Place | null, space: boolean,
): Promise<(scan: number) => Beams> {
  const counts = await payload.numbers("count", 2);
  const readings = await payload.numbers("readings", 4);
  const silent = await payload.numbers("silent", 4);
  const azimuth = await payload.numbers("azimuth", 2);
  const reach = await payload.numbers("reach", 2);
  const returned = await payload.numbers("returned", 1);
  const elevation = space ? await payload.numbers("elevation", 2) : null;
  const first = new Uint32Array(counts.length + 1);
  for (let i = 0; i < counts.length; i++) first[i + 1] = first[i]! + counts[i]!;
  return (scan) => {
    const [from, to] = [first[scan]!, first[scan + 1]!];
    const starts = new Float64Array(3 * (to - from));
    const ends = new Float64Array(3 * (to - from));
    const place = at(scan);
    for (let i = from; place && i < to; i++) {
      const length = reach[i]! * payload.facts.reach_unit;
      const up = elevation ? signed(elevation[i]!) : 0;
      const way = place.yaw + TURN * azimuth[i]!;
      const flat = length * Math.cos(up);
      starts.set([place.x, place.y, place.z], 3 * (i - from));
      ends.set([place.x + flat * Math.cos(way), place.y + flat * Math.sin(way), place.z + length * Math.sin(up)],
        3 * (i - from));
    }
    return { starts, ends, returned: returned.slice(from, to), readings: readings[scan]!, silent: silent[scan]! };
  };
}

/** Points of two or three coordinates, one after the other, with three each. */
export function inSpace(flat: readonly number[], axes: number): Float64Array {
  const points = new Float64Array((3 * flat.length) / axes);
  for (let i = 0, j = 0; i < flat.length; i += axes, j += 3) {
    for (let axis = 0; axis < axes; axis++) points[j + axis] = flat[i + axis]!;
  }
  return points;
}
