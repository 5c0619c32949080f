// SPDX-License-Identifier: Apache-2.0
// A 2D map on the graphics card: the counts of all levels as textures, uploaded once. A frame is one
// draw call, and a slider uploads nothing.

import type { Camera } from "./camera";
import type { Palette } from "./colours";
import { compile, type Program, texture } from "./gl";
import type { PlaneFacts } from "./payload";
import { fragmentShader, VERTEX } from "./plane_shader";
import { isOfCounts } from "./posterior";
import { PosteriorTables } from "./posterior_shader";
import type { Level, Pyramid } from "./pyramid";
import type { Settings } from "./settings";

/** Side of a layer of a texture: every graphics card has this, and some have no more than 8192. */
const LARGEST_LAYER = 2048;
/** From afar, at most 8 x 8 cells of the map are looked at for one on the screen. */
const MOST_LOOKED_AT = 3;

interface OnCard {
  readonly counts: WebGLTexture;
  readonly table: WebGLTexture;
  readonly whole: boolean;
  readonly across: number;
}

/** What is drawn of a level: blocks of its cells, in one colour each. */
export interface Shown {
  readonly level: number;
  readonly block: number;
}

/** Which cells are shown at a scale of cells in a pixel: those at least as large as a pixel. */
export function shownAt(pyramid: Pyramid, set: Settings, scale: number): Shown {
  const wanted = Math.max(0, Math.ceil(Math.log2(scale) - 1e-9));
  const coarsest = pyramid.levels.length - 1;
  if (isOfCounts(set.posterior) && (set.fromAfar === "sums" || set.posterior === "interval-width")) {
    return { level: Math.min(wanted, coarsest), block: 1 };
  }
  const within = Math.min(wanted, MOST_LOOKED_AT);
  return { level: Math.min(wanted - within, coarsest), block: 2 ** within };
}

export class PlaneLayer {
  /** What was done so far, for tests. */
  readonly stats = { draws: 0, uploaded: 0 };
  private readonly programs = new Map<boolean, Program>();
  private readonly levels: OnCard[];
  private readonly tables: PosteriorTables;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    facts: PlaneFacts,
    private readonly pyramid: Pyramid,
  ) {
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.disable(gl.DITHER);
    gl.bindVertexArray(gl.createVertexArray());
    this.levels = pyramid.levels.map((level) => this.upload(level));
    this.tables = new PosteriorTables(gl, facts, (bytes) => (this.stats.uploaded += bytes));
    const error = gl.getError();
    if (error === gl.OUT_OF_MEMORY) {
      throw new Error("the graphics card has no room for this map: show a part of it (oddsmap crop)");
    }
    if (error !== gl.NO_ERROR && error !== gl.CONTEXT_LOST_WEBGL) {
      throw new Error(`the graphics card refuses the map (WebGL error ${error})`);
    }
  }

  /** Draw what the camera sees on the screen of the context. */
  draw(camera: Camera, set: Settings, palette: Palette): void {
    const { gl } = this;
    gl.viewport(0, 0, camera.width, camera.height);
    const { level, block } = shownAt(this.pyramid, set, camera.scale);
    const program = this.use(level, set, palette);
    const { factor } = this.pyramid.levels[level]!;
    this.place(program, level, camera.x / factor, camera.y / factor);
    gl.uniform2f(program.at("u_middle"), camera.width / 2, camera.height / 2);
    gl.uniform1f(program.at("u_scale"), camera.scale / factor);
    gl.uniform1i(program.at("u_block"), block);
    gl.uniform1i(program.at("u_probe"), 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.stats.draws++;
  }

  /** The value that the graphics card works out for one cell of a level; null: it is unknown. */
  probe(set: Settings, palette: Palette, level: number, x: number, y: number): number | null {
    const { gl } = this;
    const target = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, target);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, 1, 1);
    const buffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    gl.viewport(0, 0, 1, 1);
    const program = this.use(level, set, palette);
    this.place(program, level, x + 0.5, y + 0.5);
    gl.uniform2f(program.at("u_middle"), 0.5, 0.5);
    gl.uniform1f(program.at("u_scale"), 1);
    gl.uniform1i(program.at("u_block"), 1);
    gl.uniform1i(program.at("u_probe"), 1);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const [high, middle, low, seen] = this.pixel();
    gl.deleteFramebuffer(buffer);
    gl.deleteTexture(target);
    return seen === 0 ? null : (high * 65536 + middle * 256 + low) / 16777215;
  }

  private pixel(): [number, number, number, number] {
    const bytes = new Uint8Array(4);
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, bytes);
    return [bytes[0]!, bytes[1]!, bytes[2]!, bytes[3]!];
  }

  private use(level: number, set: Settings, palette: Palette): Program {
    const { gl } = this;
    const { counts, table: places, whole, across } = this.levels[level]!;
    let program = this.programs.get(whole);
    if (!program) this.programs.set(whole, (program = compile(gl, VERTEX, fragmentShader(whole))));
    gl.useProgram(program.handle);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, counts);
    gl.uniform1i(program.at("u_counts"), 0);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, places);
    gl.uniform1i(program.at("u_table"), 1);
    this.tables.use(program, 2, set, palette);
    gl.uniform1f(program.at("u_unit"), whole ? this.pyramid.unit : 1);
    gl.uniform1i(program.at("u_tile"), this.pyramid.tile);
    gl.uniform1i(program.at("u_across"), across);
    gl.uniform3f(program.at("u_unknown"), ...palette.unknown);
    return program;
  }

  /** Where the middle of the screen lies, as a whole number and what is left of it: however far the
   * map is from its origin, a pixel is exact. */
  private place(program: Program, level: number, x: number, y: number): void {
    const { first } = this.pyramid.levels[level]!;
    const { tile } = this.pyramid;
    const [column, row] = [Math.floor(x), Math.floor(y)];
    this.gl.uniform2i(program.at("u_cell"), column - first[0] * tile, row - first[1] * tile);
    this.gl.uniform2f(program.at("u_within"), x - column, y - row);
  }

  private upload(level: Level): OnCard {
    const { gl } = this;
    const { tile, unit } = this.pyramid;
    const most = Math.floor(Math.min(gl.getParameter(gl.MAX_TEXTURE_SIZE) as number, LARGEST_LAYER) / tile);
    const across = Math.min(most, Math.ceil(Math.sqrt(level.tiles)));
    const layers = Math.ceil(level.tiles / across ** 2);
    if (layers > (gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS) as number)) {
      throw new Error("the map has too many tiles for this graphics card: show a part of it (oddsmap crop)");
    }
    const { hits, passes } = level;
    const narrow = hits instanceof Uint8Array && passes instanceof Uint8Array;
    const whole = (narrow || hits instanceof Uint16Array || hits instanceof Uint8Array)
      && (passes instanceof Uint16Array || passes instanceof Uint8Array);
    const [format, kind, type] = narrow
      ? ([gl.RG8UI, gl.RG_INTEGER, gl.UNSIGNED_BYTE] as const)
      : whole
        ? ([gl.RG16UI, gl.RG_INTEGER, gl.UNSIGNED_SHORT] as const)
        : ([gl.RG32F, gl.RG, gl.FLOAT] as const);
    const size = tile * tile;
    const pairs = narrow ? new Uint8Array(2 * size) : whole ? new Uint16Array(2 * size) : new Float32Array(2 * size);
    const votes = whole ? 1 : unit;
    const counts = texture(gl, gl.TEXTURE_2D_ARRAY);
    const rows = Math.min(across, Math.ceil(level.tiles / across));
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, format, across * tile, rows * tile, layers);
    for (let i = 0; i < level.tiles; i++) {
      for (let j = 0; j < size; j++) {
        pairs[2 * j] = hits[i * size + j]! * votes;
        pairs[2 * j + 1] = passes[i * size + j]! * votes;
      }
      const row = Math.floor(i / across);
      gl.texSubImage3D(
        gl.TEXTURE_2D_ARRAY, 0, (i % across) * tile, (row % across) * tile, Math.floor(row / across),
        tile, tile, 1, kind, type, pairs,
      );
      this.stats.uploaded += pairs.byteLength;
    }
    const table = texture(gl, gl.TEXTURE_2D);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32UI, level.columns, level.rows);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, level.columns, level.rows, gl.RED_INTEGER, gl.UNSIGNED_INT, level.table);
    this.stats.uploaded += level.table.byteLength;
    return { counts, table, whole, across };
  }
}
