// SPDX-License-Identifier: Apache-2.0
// Which voxel a ray meets first, and which are near. Voxels are listed by blocks of space, so that only
// those of some blocks are looked at.

import type { Vector } from "./space_camera";
import type { Clip, Points } from "./voxels";

/** So many blocks at most; they are as small as that allows, but not smaller than 8 voxels. */
const MOST_BLOCKS = 1 << 21;
const SMALLEST = 3;

export class VoxelBlocks {
  /** Voxels along a block, as a power of two, and blocks along each axis of the map. */
  private readonly power: number;
  private readonly across: Vector;
  /** Where the voxels of a block begin in `order`; those of the next one end them. */
  private readonly starts: Uint32Array;
  private readonly order: Uint32Array;

  /** @param box around all of them. */
  constructor(private readonly points: Pick<Points, "count" | "places">, private readonly box: Clip) {
    const { count, places } = points;
    const { lo, hi } = box;
    const acrossAt = (power: number): Vector =>
      lo.map((from, axis) => ((hi[axis]! - 1 - from) >> power) + 1) as Vector;
    let power = SMALLEST;
    while (acrossAt(power).reduce((all, n) => all * n) > MOST_BLOCKS) power++;
    this.power = power;
    const [nx, ny, nz] = this.across = acrossAt(power);
    const [x0, y0, z0] = lo as Vector;
    const blockOf = (i: number): number => (((places[4 * i + 2]! - z0) >> power) * ny
      + ((places[4 * i + 1]! - y0) >> power)) * nx + ((places[4 * i]! - x0) >> power);
    const starts = new Uint32Array(nx * ny * nz + 1);
    for (let i = 0; i < count; i++) starts[blockOf(i) + 1]!++;
    for (let block = 1; block < starts.length; block++) starts[block]! += starts[block - 1]!;
    this.starts = starts;
    this.order = new Uint32Array(count);
    const next = starts.slice();
    for (let i = 0; i < count; i++) this.order[next[blockOf(i)]!++] = i;
  }

  /**
   * The number of the first voxel that a ray enters; null: it enters none.
   *
   * @param eye where the ray begins, in voxels from the first cell of the map.
   * @param ray its direction, of any length.
   * @param counts whether a voxel that it meets is one of those looked for.
   */
  first(eye: Vector, ray: Vector, counts: (voxel: number) => boolean): number | null {
    const { lo, hi } = this.box;
    const way = ray.map((x) => (Math.abs(x) < 1e-12 ? 1e-12 : x)) as Vector;
    const side = 2 ** this.power;
    let from = 0;
    let to = Infinity;
    for (let axis = 0; axis < 3; axis++) {
      const [a, b] = [(lo[axis]! - eye[axis]!) / way[axis]!, (hi[axis]! - eye[axis]!) / way[axis]!];
      from = Math.max(from, Math.min(a, b));
      to = Math.min(to, Math.max(a, b));
    }
    if (from > to) return null;
    const block = way.map((x, axis) => {
      const at = Math.floor((eye[axis]! + from * x - lo[axis]!) / side);
      return Math.min(Math.max(at, 0), this.across[axis]! - 1);
    }) as Vector;
    // Where the ray leaves the block along each axis.
    const leave = way.map((x, axis) =>
      ((block[axis]! + (x > 0 ? 1 : 0)) * side + lo[axis]! - eye[axis]!) / x) as Vector;
    for (;;) {
      // Blocks are made of whole voxels: what is met in this one lies before all that is met later.
      const found = this.firstIn((block[2] * this.across[1] + block[1]) * this.across[0] + block[0], eye, way, counts);
      if (found !== null) return found;
      const axis = leave.indexOf(Math.min(...leave));
      const step = way[axis]! > 0 ? 1 : -1;
      block[axis]! += step;
      if (block[axis]! < 0 || block[axis]! >= this.across[axis]!) return null;
      leave[axis]! += (step * side) / way[axis]!;
    }
  }

  private firstIn(block: number, eye: Vector, ray: Vector, counts: (voxel: number) => boolean): number | null {
    const { places } = this.points;
    const [ex, ey, ez] = eye;
    const [rx, ry, rz] = ray;
    const [hx, hy, hz] = [0.5 / Math.abs(rx), 0.5 / Math.abs(ry), 0.5 / Math.abs(rz)];
    let best = Infinity;
    let found: number | null = null;
    for (let j = this.starts[block]!, end = this.starts[block + 1]!; j < end; j++) {
      const i = this.order[j]!;
      const x = (places[4 * i]! + 0.5 - ex) / rx;
      const y = (places[4 * i + 1]! + 0.5 - ey) / ry;
      const z = (places[4 * i + 2]! + 0.5 - ez) / rz;
      const enter = Math.max(x - hx, y - hy, z - hz);
      const exit = Math.min(x + hx, y + hy, z + hz);
      if (enter > exit || enter < 0 || enter >= best || !counts(i)) continue;
      best = enter;
      found = i;
    }
    return found;
  }

  /** The numbers of the voxels in a cube around the voxel that a place lies in. */
  near(place: Vector, radius: number): number[] {
    const { places } = this.points;
    const [x0, y0, z0] = place.map((x) => Math.floor(x) - radius) as Vector;
    const side = 2 * radius;
    const [[bx, ex], [by, ey], [bz, ez]] = [x0, y0, z0].map((from, axis) => [
      Math.max((from - this.box.lo[axis]!) >> this.power, 0),
      Math.min((from + side - this.box.lo[axis]!) >> this.power, this.across[axis]! - 1),
    ]) as [[number, number], [number, number], [number, number]];
    const found: number[] = [];
    if (bx > ex) return found;
    for (let z = bz; z <= ez; z++) {
      for (let y = by; y <= ey; y++) {
        const row = (z * this.across[1] + y) * this.across[0];
        // Blocks along x follow each other.
        for (let j = this.starts[row + bx]!, end = this.starts[row + ex + 1]!; j < end; j++) {
          const i = this.order[j]!;
          const [dx, dy, dz] = [places[4 * i]! - x0, places[4 * i + 1]! - y0, places[4 * i + 2]! - z0];
          if (dx >= 0 && dx <= side && dy >= 0 && dy <= side && dz >= 0 && dz <= side) found.push(i);
        }
      }
    }
    return found;
  }
}
