// SPDX-License-Identifier: Apache-2.0
// The viewer of a 3D map: its occupied voxels, how many they are, and the panel beside them.

import { airOf, MOST_DRAWN, type Slice, sliceOf, wholeAir } from "./air";
import { type SpacePalettes, spacePalettes } from "./colours";
import { element } from "./dom";
import { Frames, pixelsOf, untilClosed } from "./frames";
import { COUNTS, givenOf, sheetOf, type Sheets } from "./given";
import { headingOf, isDark } from "./heading";
import type { Host, LogView } from "./log_view";
import type { Eye } from "./overlay";
import { panelOf } from "./panel";
import type { Payload, SpaceFacts } from "./payload";
import { lengthInWords, roundLength } from "./scale_bar";
import { settingsOf, showsAir, Store } from "./settings";
import { SpaceCamera, type Vector } from "./space_camera";
import { listenInSpace } from "./space_input";
import { SpaceLayer } from "./space_layer";
import { spacePanel } from "./space_panel";
import { SpaceOverlay } from "./space_overlay";
import { type Picked, SpacePicking } from "./space_picking";
import { count, describeVotes, indices, metres } from "./words";
import { type Clip, drawnIn, occupiedIn, type Points, sliceAt, type Voxels } from "./voxels";

/** Voxels are counted once nothing has been changed for so long [ms]. */
const COUNTED_AFTER = 80;
/** How far from the pointer a voxel may be where none is under it [pixels of the page]. */
const BESIDE = [2, 4];
const SCALE_BAR = 220;

/** The box around boxes. */
const around = (boxes: readonly Clip[]): Clip => ({
  lo: [0, 1, 2].map((axis) => Math.min(...boxes.map(({ lo }) => lo[axis]!))),
  hi: [0, 1, 2].map((axis) => Math.max(...boxes.map(({ hi }) => hi[axis]!))),
});

export class SpaceViewer implements Host {
  /** What is drawn above the map, and what is asked about it, where its log is there. */
  afterDraw: (() => void) | null = null;
  asked: ((cell: readonly number[]) => void) | null = null;
  log: LogView | null = null;
  readonly camera: SpaceCamera;
  readonly store: Store;
  /** How many voxels are occupied and inside the clip box; null: they are being counted. */
  occupied: number | null = null;
  private layers: ReadonlyMap<string, SpaceLayer>;
  private readonly canvas = element("canvas", {
    tabindex: 0, role: "application",
    "aria-label": "Map in space. Arrow keys turn it; W, A, S, D, Q and E move; plus and minus zoom; "
      + "0 shows all of it, 1 from above. The voxel in the middle is described.",
  });
  private readonly counted = element("output", { class: "words", "aria-live": "polite" });
  private readonly position = element("div", { class: "position" });
  private readonly words = element("output", { class: "words" });
  private readonly bar = element("div", { class: "scale-bar" });
  private readonly overlay = new SpaceOverlay();
  private readonly pickings: ReadonlyMap<string, SpacePicking>;
  private readonly listeners: ((index: Vector) => void)[] = [];
  private pointer: readonly [number, number] | null = null;
  private byKeys = false;
  private readonly panel;
  private readonly frames = new Frames(() => this.draw());
  private readonly describing = new Frames(() => this.describe());
  private readonly ending = new AbortController();
  private counting: ReturnType<typeof setTimeout> | undefined;

  private air: Points | null = null;
  private slice: Slice | null = null;
  /** Settled once what is not there at the start, free space or a slice, is unpacked and shown. */
  unpacked: Promise<void> = Promise.resolve();
  private isUnpacking = false;
  readonly facts: SpaceFacts;

  constructor(
    readonly root: HTMLElement,
    private readonly payload: Payload<SpaceFacts>,
    private readonly sheets: Sheets<Voxels>,
  ) {
    const { facts } = payload;
    this.facts = facts;
    this.store = new Store(settingsOf(facts));
    this.camera = new SpaceCamera(around([...sheets.values()].map(({ box }) => box)));
    this.panel = panelOf(facts, this.store, spacePanel(facts, this.store, () => this.palettes()));
    const gl = this.canvas.getContext("webgl2", { alpha: false, antialias: false });
    if (!gl) {
      throw new Error("this browser has no WebGL 2, which the map is drawn with: try another one, or "
        + "switch hardware acceleration on");
    }
    this.layers = this.layersOn(gl);
    this.pickings = new Map([...sheets].map(([name, voxels]) => [name, new SpacePicking(facts, voxels)]));
    root.replaceChildren(
      element("div", { class: "map space" }, this.canvas, this.overlay.root, this.overlay.axes,
        element("div", { class: "readout" }, element("div", { class: "where" }, this.counted, this.bar), this.position,
          this.words)),
      element("div", { class: "side space" }, headingOf(root, facts, () => this.changed(), this.ending.signal), this.panel.root),
    );
    this.store.listen(() => this.changed());
    listenInSpace(this.canvas, this.camera, {
      aroundEye: () => this.store.value.drag === "fly",
      moved: () => this.frames.schedule(),
      pointed: (at) => this.pointed(at, false),
      keyed: () => this.pointed(this.pointer, true),
      clicked: (at) => {
        const found = this.nearest(...(at ?? this.middle()));
        if (!found) return;
        this.asked?.(found.index);
        for (const listener of this.listeners) listener(found.index);
      },
    });
    this.canvas.addEventListener("blur", () => this.pointed(this.pointer, false));
    untilClosed(this.canvas, gl, this.ending.signal, () => this.resize());
    this.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.layers = this.layersOn(gl);
      this.layers.get(COUNTS)?.showAir(this.air);
      this.layers.get(COUNTS)?.showSlice(this.slice);
      this.frames.schedule();
    });
    this.resize();
    this.camera.fit();
    this.changed();
  }

  /** Let go of the graphics card and of the page. */
  close(): void {
    this.ending.abort();
    clearTimeout(this.counting);
  }

  /** The map that is shown, what draws it, and what finds its voxels. */
  get voxels(): Voxels {
    return this.sheets.get(sheetOf(this.store.value.posterior))!;
  }

  private get layer(): SpaceLayer {
    return this.layers.get(sheetOf(this.store.value.posterior))!;
  }

  private get picking(): SpacePicking {
    return this.pickings.get(sheetOf(this.store.value.posterior))!;
  }

  private layersOn(gl: WebGL2RenderingContext): ReadonlyMap<string, SpaceLayer> {
    return new Map([...this.sheets].map(([name, voxels]) => [name, new SpaceLayer(gl, this.facts, voxels)]));
  }

  get frameTime(): number {
    return this.frames.time;
  }

  get stats(): { draws: number; uploaded: number; vertices: number } {
    return this.layer.stats;
  }

  /** The voxel that is drawn at a pixel of the canvas, counted from the top left. */
  pick(x: number, y: number): Picked | null {
    return this.picking.at(this.camera, this.store.value, x, y);
  }

  /** The same of a pixel that is pointed at: what lies a little beside it, where nothing is right there. */
  private nearest(x: number, y: number): Picked | null {
    let found = this.pick(x, y);
    for (const radius of found ? [] : BESIDE) {
      for (let eighth = 0; eighth < 8 && !found; eighth++) {
        const angle = (eighth * Math.PI) / 4;
        const far = radius * this.ratio();
        found = this.pick(x + far * Math.cos(angle), y + far * Math.sin(angle));
      }
    }
    return found;
  }

  /** Pixels of the screen in one of the page. */
  private ratio(): number {
    return this.canvas.width / Math.max(this.canvas.clientWidth, 1);
  }

  /** Tell a listener of each voxel that is clicked, by its index in the map. */
  onPick(listener: (index: Vector) => void): void {
    this.listeners.push(listener);
  }

  private pointed(at: readonly [number, number] | null, byKeys: boolean): void {
    this.pointer = at;
    this.byKeys = byKeys;
    this.describing.schedule();
  }

  private middle(): [number, number] {
    return [this.camera.width / 2, this.camera.height / 2];
  }

  redraw(): void {
    this.frames.schedule();
  }

  eye(): Eye {
    const { camera, canvas, facts: { resolution, lo } } = this;
    const from = camera.eye();
    const [right, up, back] = camera.axes();
    return {
      width: canvas.width, height: canvas.height, ratio: canvas.width / Math.max(canvas.clientWidth, 1),
      focal: camera.focal, near: 0.1,
      see(x, y, z) {
        const [a, b, c] = [x / resolution - lo[0] - from[0], y / resolution - lo[1] - from[1], z / resolution - lo[2] - from[2]];
        return [
          right[0] * a + right[1] * b + right[2] * c, up[0] * a + up[1] * b + up[2] * c,
          -(back[0] * a + back[1] * b + back[2] * c),
        ];
      },
    };
  }

  private changed(): void {
    this.panel.update(this.palettes().voxels);
    if (!this.isUnpacking) this.unpacked = this.unpack();
    this.occupied = null;
    clearTimeout(this.counting);
    this.counting = setTimeout(() => this.count(), COUNTED_AFTER);
    this.frames.schedule();
  }

  private palettes(): SpacePalettes {
    return spacePalettes(this.store.value, isDark(this.root));
  }

  /** Unpack what settings ask for, until they ask for nothing else. */
  private async unpack(): Promise<void> {
    const { facts, payload } = this;
    this.isUnpacking = true;
    try {
      for (;;) {
        const height = sliceAt(facts, this.store.value);
        if (height !== (this.slice?.height ?? null)) {
          this.slice = height === null ? null : await sliceOf(payload, this.sheets.get(COUNTS)!, height);
          this.layers.get(COUNTS)?.showSlice(this.slice);
          this.pickings.get(COUNTS)!.slice = this.slice;
        } else if (showsAir(this.store.value) && !this.air && facts.air && airOf(facts) <= MOST_DRAWN) {
          this.air = await wholeAir(payload);
          this.layers.get(COUNTS)?.showAir(this.air);
        } else {
          break;
        }
        this.frames.schedule();
      }
    } catch (error) {
      const why = error instanceof Error ? error.message : String(error);
      this.words.replaceChildren(`Free space cannot be shown: ${why}`);
    } finally {
      this.isUnpacking = false;
    }
  }

  private count(): void {
    const { facts, voxels } = this;
    this.occupied = occupiedIn(facts, voxels, this.store.value, drawnIn(facts, this.store.value));
    const given = givenOf(facts, this.store.value.posterior);
    const all = given ? `above p = ${facts.free}` : "with hits";
    this.counted.textContent = `${count(this.occupied)} occupied voxels, of ${count(voxels.count)} ${all}`;
  }

  private resize(): void {
    const size = pixelsOf(this.canvas);
    if (!size) return;
    const whole = this.camera.isFitted();
    Object.assign(this.canvas, size);
    Object.assign(this.camera, size);
    if (whole) this.camera.fit(this.camera.yaw, this.camera.pitch);
    this.frames.schedule();
  }

  private draw(): void {
    this.layer.draw(this.camera, this.store.value, this.palettes());
    this.overlay.turn(this.camera);
    const inPixel = (this.camera.distance / this.camera.focal) * this.ratio() * this.facts.resolution;
    const length = roundLength(inPixel, SCALE_BAR);
    this.bar.textContent = `${lengthInWords(length)} (middle)`;
    this.bar.style.width = `${length / inPixel}px`;
    this.describe();
    this.afterDraw?.();
  }

  /** Say what is pointed at, and frame it: nothing is drawn anew for that. */
  private describe(): void {
    const { facts } = this;
    const at = this.byKeys ? this.middle() : this.pointer;
    const found = at && this.nearest(...at);
    this.words.setAttribute("aria-live", this.byKeys ? "polite" : "off");
    this.overlay.frame(this.camera, found?.place ?? null, this.ratio());
    if (!found) {
      this.position.textContent = "";
      this.words.replaceChildren(at ? "No voxel is here." : "Point at a voxel to see what is known of it.");
      return;
    }
    const middle = found.index.map((i) => metres((i + 0.5) * facts.resolution, facts.resolution));
    this.position.textContent = `x ${middle[0]} m, y ${middle[1]} m, z ${middle[2]} m`;
    const lines = [`voxel ${indices(found.index)}`,
      ...describeVotes(facts, this.store.value, found.hits, found.passes)];
    this.words.replaceChildren(...lines.map((line) => element("div", {}, line)));
  }
}