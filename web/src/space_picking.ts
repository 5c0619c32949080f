// SPDX-License-Identifier: Apache-2.0
// Which voxel is pointed at, and what is known of it, in double precision.

import type { SpaceFacts } from "./payload";
import { valueOf } from "./posterior";
import type { Settings } from "./settings";
import type { SpaceCamera, Vector } from "./space_camera";
import { NEAREST } from "./space_layer";
import type { Slice } from "./air";
import { type Clip, clipOf, drawnIn, isInside, type Voxels, votesOf } from "./voxels";

export interface Picked {
  /** Counted from the origin of the map. */
  readonly index: Vector;
  /** Counted from the first cell of the map. */
  readonly place: Vector;
  /** Votes. */
  readonly hits: number;
  readonly passes: number;
}

export class SpacePicking {
  /** Its cells are pointed at, too. */
  slice: Slice | null = null;

  constructor(private readonly facts: SpaceFacts, private readonly voxels: Voxels) {}

  /** The voxel that is drawn at a pixel, counted from the top left; null: there is none. */
  at(camera: SpaceCamera, set: Settings, x: number, y: number): Picked | null {
    const [eye, ray] = [camera.eye(), camera.rayAt(x, y)];
    const inSlice = (): Picked | null => this.inSlice(eye, ray, clipOf(this.facts, set));
    const inFront = (): Picked | null => this.amongVoxels(set, eye, ray);
    // All voxels that are drawn lie below a slice.
    return this.slice && eye[2] > this.slice.height + 0.5 ? inSlice() ?? inFront() : inFront() ?? inSlice();
  }

  private inSlice(eye: Vector, ray: Vector, clip: Clip): Picked | null {
    const { slice } = this;
    if (!slice) return null;
    const far = (slice.height + 0.5 - eye[2]) / ray[2];
    if (!(far > NEAREST) || !Number.isFinite(far)) return null;
    const place = [Math.floor(eye[0] + far * ray[0]), Math.floor(eye[1] + far * ray[1]), slice.height] as Vector;
    if ([0, 1].some((axis) => place[axis]! < clip.lo[axis]! || place[axis]! >= clip.hi[axis]!)) return null;
    const found = slice.blocks.first([place[0] + 0.5, place[1] + 0.5, slice.height + 2], [0, 0, -1], () => true);
    const [hits, passes] = found === null ? [0, 0] : slice.votes.subarray(2 * found, 2 * found + 2);
    return this.picked(place, hits!, passes!);
  }

  private amongVoxels(set: Settings, eye: Vector, ray: Vector): Picked | null {
    const { facts, voxels } = this;
    const clip = drawnIn(facts, set);
    const found = voxels.blocks.first(eye, ray, (i) =>
      isInside(clip, voxels, i) && valueOf(facts, set, ...votesOf(voxels, i)) >= set.occupied);
    if (found === null) return null;
    return this.picked([...voxels.places.subarray(4 * found, 4 * found + 3)] as Vector, ...votesOf(voxels, found));
  }

  private picked(place: Vector, hits: number, passes: number): Picked {
    return { index: place.map((at, axis) => at + this.facts.lo[axis]!) as Vector, place, hits, passes };
  }
}
