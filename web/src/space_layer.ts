// SPDX-License-Identifier: Apache-2.0
// The voxels of a 3D map on the graphics card, uploaded once. A frame is one draw call for each kind of
// thing that is drawn, and a slider uploads nothing; only another slice is uploaded.

import type { Slice } from "./air";
import type { Palette, SpacePalettes } from "./colours";
import { compile, type Program } from "./gl";
import type { SpaceFacts } from "./payload";
import { PosteriorTables } from "./posterior_shader";
import { showsAir, type Settings } from "./settings";
import type { SpaceCamera } from "./space_camera";
import { DRAWS, GROUND_FRAGMENT, GROUND_VERTEX, PAINTS, SPACE_FRAGMENT, SPACE_VERTEX } from "./space_shader";
import type { VoxelBlocks } from "./voxel_blocks";
import { type Clip, clipOf, drawnIn, type Points, type Voxels } from "./voxels";

/** Nothing nearer than this is drawn [voxels]. */
export const NEAREST = 0.1;

/** Voxels so near are drawn by their faces where no point would do, see the shader. */
const NEAR = 16;
const MOST_NEAR = 64;
/** Vertices of three faces. */
const FACES = 18;

/** Points on the graphics card. */
interface Cloud {
  readonly points: Points;
  readonly array: WebGLVertexArrayObject;
  readonly buffers: readonly WebGLBuffer[];
}

/** Points of which those near the eye are on the graphics card once more. */
interface Solid {
  readonly cloud: Cloud;
  readonly blocks: VoxelBlocks;
  near: Cloud | null;
  /** Around which voxel, and how far. */
  around: string;
}

export class SpaceLayer {
  /** What was done so far, and vertices of voxels in a frame; for tests. */
  readonly stats = { draws: 0, uploaded: 0, vertices: 0 };
  private readonly program: Program;
  private readonly ground: Program;
  private readonly tables: PosteriorTables;
  private readonly largestPoint: number;
  private readonly voxels: Solid;
  private readonly mostHits: number;
  private air: Cloud | null = null;
  private slice: (Solid & { readonly height: number }) | null = null;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    private readonly facts: SpaceFacts,
    voxels: Voxels,
  ) {
    gl.disable(gl.DITHER);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    this.mostHits = voxels.mostHits;
    this.largestPoint = (gl.getParameter(gl.ALIASED_POINT_SIZE_RANGE) as Float32Array)[1]!;
    this.program = compile(gl, SPACE_VERTEX, SPACE_FRAGMENT);
    this.ground = compile(gl, GROUND_VERTEX, GROUND_FRAGMENT);
    this.tables = new PosteriorTables(gl, facts, (bytes) => (this.stats.uploaded += bytes));
    this.voxels = this.solid(voxels);
    this.check();
  }

  /** Voxels without hits, as points; null: none. */
  showAir(points: Points | null): void {
    this.forget(this.air);
    this.air = points && this.upload(points);
    this.check();
  }

  showSlice(slice: Slice | null): void {
    this.forget(this.slice?.cloud ?? null);
    this.forget(this.slice?.near ?? null);
    this.slice = slice && { ...this.solid(slice), height: slice.height };
    this.check();
  }

  draw(camera: SpaceCamera, set: Settings, palettes: SpacePalettes): void {
    const { gl, slice, voxels } = this;
    gl.viewport(0, 0, camera.width, camera.height);
    const [red, green, blue] = palettes.background;
    gl.clearColor(red / 255, green / 255, blue / 255, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    // Nothing is above a slice: from above it hides all, from below all hides it.
    const fromAbove = slice !== null && camera.eye()[2] > slice.height + 0.5;
    if (slice && !fromAbove) this.drawSlice(camera, set, palettes);
    gl.enable(gl.DEPTH_TEST);
    const clip = drawnIn(this.facts, set);
    this.useVoxels(camera, set, palettes.voxels, clip);
    this.drawSolid(voxels, camera, DRAWS.boxes);
    this.stats.vertices = voxels.cloud.points.count;
    if (showsAir(set)) {
      gl.uniform2f(this.program.at("u_opacity"), set.opacity, set.voxels === "known" ? set.opacity : 0);
      gl.uniform3f(this.program.at("u_free"), ...palettes.free);
      gl.enable(gl.BLEND);
      gl.depthMask(false);
      this.drawCloud(voxels.cloud, DRAWS.points);
      if (this.air) this.drawCloud(this.air, DRAWS.points);
      gl.depthMask(true);
      gl.disable(gl.BLEND);
    }
    gl.disable(gl.DEPTH_TEST);
    if (slice && fromAbove) this.drawSlice(camera, set, palettes);
  }

  private drawSlice(camera: SpaceCamera, set: Settings, palettes: SpacePalettes): void {
    const { gl, ground } = this;
    const { height } = this.slice!;
    const { lo, hi } = clipOf(this.facts, set);
    gl.useProgram(ground.handle);
    this.look(ground, camera);
    gl.uniform4f(ground.at("u_sides"), lo[0]!, lo[1]!, hi[0]!, hi[1]!);
    gl.uniform1f(ground.at("u_height"), height + 0.5);
    gl.uniform3f(ground.at("u_colour"), ...palettes.slice.unknown);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    this.stats.draws++;
    const clip = { lo: [lo[0]!, lo[1]!, height], hi: [hi[0]!, hi[1]!, height + 1] };
    this.useVoxels(camera, set, palettes.slice, clip);
    this.drawSolid(this.slice!, camera, DRAWS.slice);
  }

  private drawSolid(solid: Solid, camera: SpaceCamera, what: number): void {
    this.drawCloud(solid.cloud, what);
    const eye = camera.eye();
    const radius = Math.min(Math.max(Math.ceil((2 * camera.focal) / this.largestPoint), NEAR), MOST_NEAR);
    const around = [...eye.map(Math.floor), radius].join();
    if (around !== solid.around) {
      solid.around = around;
      this.forget(solid.near);
      const numbers = solid.blocks.near(eye, radius);
      solid.near = numbers.length === 0 ? null : this.upload(chosen(solid.cloud.points, numbers), 1);
    }
    if (solid.near) this.drawCloud(solid.near, what, true);
  }

  private drawCloud({ points, array }: Cloud, what: number, near = false): void {
    const { gl, program } = this;
    gl.bindVertexArray(array);
    gl.uniform1i(program.at("u_draw"), what);
    gl.uniform1i(program.at("u_near"), near ? 1 : 0);
    gl.uniform3f(program.at("u_half"), 0.5, 0.5, what === DRAWS.slice ? 0 : 0.5);
    gl.uniform1f(program.at("u_unit"), points.unit);
    if (near) gl.drawArraysInstanced(gl.TRIANGLES, 0, FACES, points.count);
    else gl.drawArrays(gl.POINTS, 0, points.count);
    this.stats.draws++;
  }

  /** The program of voxels, for those of a box. */
  private useVoxels(camera: SpaceCamera, set: Settings, palette: Palette, clip: Clip): void {
    const { gl, program, facts } = this;
    gl.useProgram(program.handle);
    this.tables.use(program, 0, set, palette);
    this.look(program, camera);
    gl.uniform1f(program.at("u_largest"), this.largestPoint);
    gl.uniform3fv(program.at("u_lo"), clip.lo);
    gl.uniform3fv(program.at("u_hi"), clip.hi);
    gl.uniform1i(program.at("u_paint"), PAINTS[set.paint]);
    const { lo, hi } = clipOf(facts, set);
    gl.uniform2f(program.at("u_heights"), lo[2]!, Math.max(hi[2]! - 1, lo[2]!));
    gl.uniform1f(program.at("u_most"), Math.log1p(this.mostHits));
  }

  /** Tell a program from where the map is seen. */
  private look(program: Program, camera: SpaceCamera): void {
    const { gl, facts } = this;
    const eye = camera.eye();
    const whole = eye.map(Math.floor);
    gl.uniform3fv(program.at("u_eye"), whole);
    gl.uniform3fv(program.at("u_within"), eye.map((x, axis) => x - whole[axis]!));
    const [right, up, back] = camera.axes();
    gl.uniformMatrix3fv(program.at("u_view"), false,
      [0, 1, 2].flatMap((axis) => [right[axis]!, up[axis]!, back[axis]!]));
    gl.uniform1f(program.at("u_focal"), camera.focal);
    gl.uniform2f(program.at("u_screen"), camera.width, camera.height);
    const size = [0, 1, 2].map((axis) => facts.hi[axis]! - facts.lo[axis]!);
    const far = Math.hypot(...size.map((n, axis) => Math.max(Math.abs(eye[axis]!), Math.abs(eye[axis]! - n)))) + 2;
    gl.uniform2f(program.at("u_range"), NEAREST, far);
  }

  private solid(points: Points & { readonly blocks: VoxelBlocks }): Solid {
    return { cloud: this.upload(points), blocks: points.blocks, near: null, around: "" };
  }

  /** @param divisor 1 where each voxel has some vertices. */
  private upload(points: Points, divisor = 0): Cloud {
    const { gl } = this;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const { places, counts } = points;
    const type = counts instanceof Uint8Array ? gl.UNSIGNED_BYTE
      : counts instanceof Uint16Array ? gl.UNSIGNED_SHORT : gl.FLOAT;
    const buffers = [this.attribute(0, 3, gl.UNSIGNED_SHORT, 8, places), this.attribute(1, 2, type, 0, counts)];
    for (const at of [0, 1]) gl.vertexAttribDivisor(at, divisor);
    return { points, array, buffers };
  }

  /** Not at each frame: the graphics card is waited for. */
  private check(): void {
    const { gl } = this;
    const error = gl.getError();
    if (error === gl.OUT_OF_MEMORY) {
      throw new Error("the graphics card has no room for this map: show a part of it (oddsmap crop)");
    }
    if (error !== gl.NO_ERROR && error !== gl.CONTEXT_LOST_WEBGL) {
      throw new Error(`the graphics card refuses the map (WebGL error ${error})`);
    }
  }

  private forget(cloud: Cloud | null): void {
    if (!cloud) return;
    this.gl.deleteVertexArray(cloud.array);
    for (const buffer of cloud.buffers) this.gl.deleteBuffer(buffer);
  }

  private attribute(
    at: number, size: number, type: number, stride: number, values: ArrayBufferView<ArrayBuffer>,
  ): WebGLBuffer {
    const { gl } = this;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, type, false, stride, 0);
    this.stats.uploaded += values.byteLength;
    return buffer;
  }
}

/** Some of the points. */
function chosen(points: Points, numbers: readonly number[]): Points {
  const places = new Uint16Array(4 * numbers.length);
  const counts = points.counts.slice(0, 2 * numbers.length);
  numbers.forEach((i, j) => {
    places.set(points.places.subarray(4 * i, 4 * i + 4), 4 * j);
    counts.set(points.counts.subarray(2 * i, 2 * i + 2), 2 * j);
  });
  return { count: numbers.length, places, counts, unit: points.unit };
}
