// SPDX-License-Identifier: Apache-2.0
// What Python packs in `oddsmap.viewer.payload`: a header of JSON and arrays, each a zlib stream.

export type Counts = Uint8Array | Uint16Array | Uint32Array | Float64Array;

/** A fitted model of counts, see `oddsmap.posterior.count_model`. */
export interface CountModel {
  log_reflect: number[];
  log_miss: number[];
  occupied: number[];
  distributions: number[][];
  share: number;
  /** Weights of hits and passes of the Beta distribution that is fitted to all cells. */
  beta: [number, number];
}

/** A map of probabilities, see `given.ts`. */
export interface GivenFacts {
  name: string;
  /** What it is: a full map, a ROS map, ... */
  what: string;
  cells: number;
  free: number;
  occupied: number;
  bytes: 1 | 2;
  /** How many probabilities are listed; null: they are evenly spaced. */
  listed: number | null;
  /** What the numbers of cells stand for: NaN for 0, unknown, then rising. */
  values: Float64Array;
}

/** A landmark; lengths in metres. */
export interface Landmark {
  id: string;
  mean: number[];
  /** Of its x and y with 95 %: longer and shorter semi-axis, angle of the longer one [rad]. */
  ellipse: [number, number, number];
  count: number;
}

/** The facts of a map; lengths in metres. */
interface CommonFacts {
  /** Whether there are hits and passes; else `given` is all there is. */
  counts: boolean;
  given: GivenFacts[];
  landmarks?: Landmark[];
  /** Of its file; empty for a map of a notebook. */
  name: string;
  sources: { source: string | null; scans: number | null }[];
  resolution: number;
  /** Where the corner between cells -1 and 0 lies, and how axes are turned about it [rad]. */
  corner: [number, number];
  yaw: number;
  /** How many are known; 0: there is no map, only landmarks. */
  cells: number;
  bytes: 1 | 2 | 4;
  unit: number;
  rounded: boolean;
  /** What only a map with counts has. */
  votes?: "scan" | "beam";
  sensor?: string;
  p_hit?: number;
  p_miss?: number;
  prior?: number;
  free: number;
  occupied: number;
  calibrated: CountModel | null;
}

/** A 2D map: its tiles, and its box in cells. */
export interface PlaneFacts extends CommonFacts {
  kind: "plane";
  tile: number;
  tiles: number;
  first_cell: [number, number];
  lo: [number, number];
  hi: [number, number];
}

/** A 3D map: its voxels with hits, and its box in voxels. */
export interface SpaceFacts extends CommonFacts {
  kind: "space";
  voxels: number;
  /** The fewest passes of a voxel without hits [votes]; null where there is none. */
  unhit?: number | null;
  /** Those without hits: heights of a slab, and which slabs there are; null: they are too many. */
  air?: { heights: number; slabs: number[] } | null;
  lo: [number, number, number];
  hi: [number, number, number];
}

export type Facts = PlaneFacts | SpaceFacts;

export interface Payload<F extends Facts = Facts> {
  facts: F;
  /** An array of unsigned integers, of its planes of bytes. */
  numbers(name: string, bytes: 1 | 2 | 4): Promise<Counts>;
}

export async function readPayload(bytes: Uint8Array<ArrayBuffer>): Promise<Payload> {
  const length = new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true);
  const text = new TextDecoder().decode(await inflated(bytes.subarray(4, 4 + length)));
  const header = JSON.parse(text) as Facts & { sections: [string, number][] };
  const sections = new Map<string, Uint8Array<ArrayBuffer>>();
  let at = 4 + length;
  for (const [name, size] of header.sections) {
    sections.set(name, bytes.subarray(at, at + size));
    at += size;
  }
  if (at !== bytes.length) throw new Error("the data of the map are incomplete");
  const plane = async (name: string): Promise<Uint8Array> => {
    const section = sections.get(name);
    if (!section) throw new Error(`the data of the map lack ${name}`);
    return inflated(section);
  };
  return {
    facts: header,
    async numbers(name, size) {
      const lowest = await plane(`${name}.0`);
      if (size === 1) return lowest;
      const all = size === 2 ? new Uint16Array(lowest) : new Uint32Array(lowest);
      for (let i = 1; i < size; i++) {
        const next = await plane(`${name}.${i}`);
        for (let j = 0; j < all.length; j++) all[j] = all[j]! + next[j]! * 256 ** i;
      }
      return all;
    },
  };
}

async function inflated(bytes: Uint8Array<ArrayBuffer>): Promise<Uint8Array> {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Bytes of text, as a file that works from the disk holds them: see `oddsmap.viewer.text`. */
export function bytesOfText(text: string, length: number): Uint8Array<ArrayBuffer> {
  const digits = new Uint8Array(128);
  for (let code = 33, digit = 0; code < 127; code++) {
    if (!`"&<`.includes(String.fromCharCode(code))) digits[code] = digit++;
  }
  const bytes = new Uint8Array(length);
  let bits = 0;
  let held = 0;
  for (let i = 0, at = 0; at < length; i += 2) {
    held = (held << 13) | (digits[text.charCodeAt(i)]! * 91 + digits[text.charCodeAt(i + 1)]!);
    for (bits += 13; bits >= 8 && at < length; bits -= 8) bytes[at++] = held >> (bits - 8);
    held &= (1 << bits) - 1;
  }
  return bytes;
}
