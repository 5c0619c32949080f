// SPDX-License-Identifier: Apache-2.0
// Which voxel is pointed at, and what is known of it, in double precision.

import type { SpaceFacts } from "./payload";
import { valueOf } from "./posterior";
import type { Settings } from "./settings";
import type { SpaceCamera, Vector } from "./space_camera";
import { NEAREST } from "./space_layer";
import { VoxelBlocks } from "./voxel_blocks";
import { clipOf, isInside, type Voxels, votesOf } from "./voxels";

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
  private readonly blocks: VoxelBlocks;

  constructor(private readonly facts: SpaceFacts, private readonly voxels: Voxels) {
    this.blocks = new VoxelBlocks(voxels);
  }

  /** The voxel that is drawn at a pixel, counted from the top left; null: there is none. */
  at(camera: SpaceCamera, set: Settings, x: number, y: number): Picked | null {
    const { facts, voxels } = this;
    const clip = clipOf(facts, set);
    const eye = camera.eye();
    const back = camera.axes()[2];
    const half = back.reduce((sum, b) => sum + Math.abs(b), 0) / 2;
    const { places } = voxels;
    const found = this.blocks.first(eye, camera.rayAt(x, y), (i) => {
      if (!isInside(clip, voxels, i)) return false;
      // As it is drawn: not where a part of it is too near.
      let depth = 0;
      for (let axis = 0; axis < 3; axis++) depth += (eye[axis]! - places[4 * i + axis]! - 0.5) * back[axis]!;
      return depth - half >= NEAREST && valueOf(facts, set, ...votesOf(voxels, i)) >= set.occupied;
    });
    if (found === null) return null;
    const place = [...places.subarray(4 * found, 4 * found + 3)] as Vector;
    const [hits, passes] = votesOf(voxels, found);
    return { index: place.map((at, axis) => at + facts.lo[axis]!) as Vector, place, hits, passes };
  }
}
