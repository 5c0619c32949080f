// SPDX-License-Identifier: Apache-2.0
// The voxels of a 3D map on the graphics card, uploaded once. A frame is one draw call, and a slider
// uploads nothing.

import type { Colour, Palette } from "./colours";
import { compile, type Program } from "./gl";
import type { SpaceFacts } from "./payload";
import { PosteriorTables } from "./posterior_shader";
import type { Settings } from "./settings";
import type { SpaceCamera } from "./space_camera";
import { PAINTS, SPACE_FRAGMENT, SPACE_VERTEX } from "./space_shader";
import { clipOf, type Voxels } from "./voxels";

/** Nothing nearer than this is drawn [voxels]. */
const NEAREST = 0.1;

export class SpaceLayer {
  /** What was done so far, and vertices of a frame; for tests. */
  readonly stats = { draws: 0, uploaded: 0, vertices: 0 };
  private readonly program: Program;
  private readonly tables: PosteriorTables;
  private readonly arrays: WebGLVertexArrayObject;
  private readonly largestPoint: number;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    private readonly facts: SpaceFacts,
    private readonly voxels: Voxels,
  ) {
    gl.disable(gl.DITHER);
    gl.enable(gl.DEPTH_TEST);
    this.arrays = gl.createVertexArray();
    gl.bindVertexArray(this.arrays);
    const type = voxels.counts instanceof Uint8Array ? gl.UNSIGNED_BYTE
      : voxels.counts instanceof Uint16Array ? gl.UNSIGNED_SHORT : gl.FLOAT;
    this.attribute(0, 3, gl.UNSIGNED_SHORT, 8, voxels.places);
    this.attribute(1, 2, type, 0, voxels.counts);
    this.largestPoint = (gl.getParameter(gl.ALIASED_POINT_SIZE_RANGE) as Float32Array)[1]!;
    this.program = compile(gl, SPACE_VERTEX, SPACE_FRAGMENT);
    this.tables = new PosteriorTables(gl, facts, (bytes) => (this.stats.uploaded += bytes));
    const error = gl.getError();
    if (error === gl.OUT_OF_MEMORY) {
      throw new Error("the graphics card has no room for this map: show a part of it (oddsmap crop)");
    }
    if (error !== gl.NO_ERROR && error !== gl.CONTEXT_LOST_WEBGL) {
      throw new Error(`the graphics card refuses the map (WebGL error ${error})`);
    }
  }

  draw(camera: SpaceCamera, set: Settings, palette: Palette, background: Colour): void {
    const { gl, program, facts, voxels } = this;
    gl.viewport(0, 0, camera.width, camera.height);
    const [red, green, blue] = background;
    gl.clearColor(red / 255, green / 255, blue / 255, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(program.handle);
    gl.bindVertexArray(this.arrays); // maps beside this one have their own
    this.tables.use(program, 0, set, palette);
    gl.uniform1f(program.at("u_unit"), voxels.unit);
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
    gl.uniform1f(program.at("u_largest"), this.largestPoint);
    const clip = clipOf(facts, set);
    gl.uniform3fv(program.at("u_lo"), clip.lo);
    gl.uniform3fv(program.at("u_hi"), clip.hi);
    gl.uniform1i(program.at("u_paint"), PAINTS[set.paint]);
    gl.uniform2f(program.at("u_heights"), clip.lo[2]!, Math.max(clip.hi[2]! - 1, clip.lo[2]!));
    gl.uniform1f(program.at("u_most"), Math.log1p(voxels.mostHits));
    gl.drawArrays(gl.POINTS, 0, voxels.count);
    this.stats.draws++;
    this.stats.vertices = voxels.count;
  }

  private attribute(at: number, size: number, type: number, stride: number, values: ArrayBufferView<ArrayBuffer>): void {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, type, false, stride, 0);
    this.stats.uploaded += values.byteLength;
  }
}
