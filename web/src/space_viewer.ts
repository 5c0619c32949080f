// SPDX-License-Identifier: Apache-2.0
// The viewer of a 3D map: its occupied voxels, how many they are, and the panel beside them.

import { type Colour, spacePalette } from "./colours";
import { element } from "./dom";
import { Frames, pixelsOf } from "./frames";
import { givenOf, sheetOf, type Sheets } from "./given";
import { headingOf, isDark } from "./heading";
import { panelOf } from "./panel";
import type { SpaceFacts } from "./payload";
import { settingsOf, Store } from "./settings";
import { SpaceCamera } from "./space_camera";
import { listenInSpace } from "./space_input";
import { SpaceLayer } from "./space_layer";
import { count } from "./words";
import { type Clip, clipOf, occupiedIn, type Voxels } from "./voxels";

const DAY: Colour = [232, 237, 242];
const NIGHT: Colour = [15, 20, 26];
/** Voxels are counted once nothing has been changed for so long [ms]. */
const COUNTED_AFTER = 80;

/** The box around boxes. */
const around = (boxes: readonly Clip[]): Clip => ({
  lo: [0, 1, 2].map((axis) => Math.min(...boxes.map(({ lo }) => lo[axis]!))),
  hi: [0, 1, 2].map((axis) => Math.max(...boxes.map(({ hi }) => hi[axis]!))),
});

export class SpaceViewer {
  readonly camera: SpaceCamera;
  readonly store: Store;
  /** How many voxels are occupied and inside the clip box; null: they are being counted. */
  occupied: number | null = null;
  private layers: ReadonlyMap<string, SpaceLayer>;
  private readonly canvas = element("canvas", {
    tabindex: 0, role: "application",
    "aria-label": "Map in space. Arrow keys turn it; W, A, S, D, Q and E move; plus and minus zoom; "
      + "0 shows all of it, 1 from above.",
  });
  private readonly words = element("output", { class: "words", "aria-live": "polite" });
  private readonly panel;
  private readonly frames = new Frames(() => this.draw());
  private counting: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly root: HTMLElement,
    readonly facts: SpaceFacts,
    private readonly sheets: Sheets<Voxels>,
  ) {
    this.store = new Store(settingsOf(facts));
    this.camera = new SpaceCamera(around([...sheets.values()].map(({ box }) => box)));
    this.panel = panelOf(facts, this.store);
    const gl = this.canvas.getContext("webgl2", { alpha: false, antialias: false });
    if (!gl) {
      throw new Error("this browser has no WebGL 2, which the map is drawn with: try another one, or "
        + "switch hardware acceleration on");
    }
    this.layers = this.layersOn(gl);
    root.replaceChildren(
      element("div", { class: "map space" }, this.canvas, element("div", { class: "readout" }, this.words)),
      element("div", { class: "side" }, headingOf(root, facts, () => this.changed()), this.panel.root),
    );
    this.store.listen(() => this.changed());
    listenInSpace(this.canvas, this.camera, () => this.store.value.drag === "fly", () => this.frames.schedule());
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.layers = this.layersOn(gl);
      this.frames.schedule();
    });
    this.resize();
    this.camera.fit();
    this.changed();
  }

  /** The map that is shown, and what draws it. */
  get voxels(): Voxels {
    return this.sheets.get(sheetOf(this.store.value.posterior))!;
  }

  private get layer(): SpaceLayer {
    return this.layers.get(sheetOf(this.store.value.posterior))!;
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

  private changed(): void {
    this.panel.update(spacePalette(isDark(this.root)));
    this.occupied = null;
    clearTimeout(this.counting);
    this.counting = setTimeout(() => this.count(), COUNTED_AFTER);
    this.frames.schedule();
  }

  private count(): void {
    const { facts, voxels } = this;
    this.occupied = occupiedIn(facts, voxels, this.store.value, clipOf(facts, this.store.value));
    const given = givenOf(facts, this.store.value.posterior);
    const all = given ? `above p = ${facts.free}` : "with hits";
    this.words.textContent = `${count(this.occupied)} occupied voxels, of ${count(voxels.count)} ${all}`;
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
    const dark = isDark(this.root);
    this.layer.draw(this.camera, this.store.value, spacePalette(dark), dark ? NIGHT : DAY);
  }
}
