// SPDX-License-Identifier: Apache-2.0
// The viewer: a map, what is said of the cell that is pointed at, and the panel beside it.

import { Camera } from "./camera";
import { paletteOf, type Palette } from "./colours";
import { element } from "./dom";
import { Frames, pixelsOf } from "./frames";
import { headingOf, isDark } from "./heading";
import { listen } from "./input";
import type { Journey } from "./journey";
import { type Host, LogView } from "./log_view";
import type { Eye } from "./overlay";
import { panelOf } from "./panel";
import type { Payload, PlaneFacts, SpaceFacts } from "./payload";
import { PlaneLayer, shownAt } from "./plane_layer";
import { valueOf } from "./posterior";
import { pyramidOf, type Pyramid, votesAt } from "./pyramid";
import { lengthInWords, roundLength } from "./scale_bar";
import { settingsOf, Store } from "./settings";
import { SpaceViewer } from "./space_viewer";
import { voxelsOf } from "./voxels";
import { type Cell, describe, metres } from "./words";

const SCALE_BAR = 140;
/** A cell is framed where it is at least so large [pixels of the page]. */
const FRAMED_FROM = 5;

export class Viewer implements Host {
  readonly camera: Camera;
  readonly store: Store;
  /** What is drawn above the map, and what is asked about it, where its log is there. */
  afterDraw: (() => void) | null = null;
  asked: ((cell: readonly number[]) => void) | null = null;
  log: LogView | null = null;
  private layer: PlaneLayer;
  private readonly canvas = element("canvas", {
    tabindex: 0, role: "application",
    "aria-label": "Map. Arrow keys move it, with Shift by one cell; plus and minus zoom, 0 shows all of it. "
      + "The cell in the middle is described.",
  });
  private readonly words = element("output", { class: "words" });
  private readonly position = element("div", { class: "position" });
  private readonly bar = element("div", { class: "scale-bar" });
  private readonly frame = element("div", { class: "frame", "aria-hidden": true, hidden: true });
  private readonly panel;
  private pointer: readonly [number, number] | null = null;
  private byKeys = false;
  private readonly frames = new Frames(() => this.draw());

  constructor(
    readonly root: HTMLElement,
    readonly facts: PlaneFacts,
    readonly pyramid: Pyramid,
  ) {
    this.store = new Store(settingsOf(facts));
    this.camera = new Camera({ lo: facts.lo, hi: facts.hi });
    this.panel = panelOf(facts, this.store);
    const gl = this.canvas.getContext("webgl2", { alpha: false, antialias: false });
    if (!gl) {
      throw new Error("this browser has no WebGL 2, which the map is drawn with: try another one, or "
        + "switch hardware acceleration on");
    }
    this.layer = new PlaneLayer(gl, facts, pyramid);
    root.replaceChildren(
      element("div", { class: "map" }, this.canvas, this.frame,
        element("div", { class: "readout" }, this.position, this.words), this.bar),
      element("div", { class: "side" }, headingOf(root, facts, () => this.changed()), this.panel.root),
    );
    this.listen(gl);
    this.resize();
    this.camera.fit();
    this.frames.schedule();
  }

  /** Of cells of a level: the value that is drawn, the one that is said, and the votes; for tests. */
  probe(level: number, cells: [number, number][]): { shown: number | null; exact: number; votes: [number, number] }[] {
    return cells.map(([x, y]) => {
      const votes = votesAt(this.pyramid, this.pyramid.levels[level]!, x, y);
      const shown = this.layer.probe(this.store.value, this.palette(), level, x, y);
      return { shown, exact: valueOf(this.facts, this.store.value, ...votes), votes };
    });
  }

  get frameTime(): number {
    return this.frames.time;
  }

  get stats(): { draws: number; uploaded: number } {
    return this.layer.stats;
  }

  private listen(gl: WebGL2RenderingContext): void {
    listen(this.canvas, this.camera, {
      moved: () => this.frames.schedule(),
      pointed: (at) => {
        this.pointer = at;
        this.byKeys = false;
        this.frames.schedule();
      },
      keyed: () => {
        this.byKeys = true;
        this.frames.schedule();
      },
      asked: (at) => this.asked?.(this.camera.at(...at).map(Math.floor)),
    });
    this.canvas.addEventListener("blur", () => {
      this.byKeys = false;
      this.frames.schedule();
    });
    this.store.listen(() => this.changed());
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.layer = new PlaneLayer(gl, this.facts, this.pyramid);
      this.frames.schedule();
    });
  }

  redraw(): void {
    this.frames.schedule();
  }

  eye(): Eye {
    const { camera, facts } = this;
    return {
      width: camera.width, height: camera.height, ratio: this.ratio(), focal: 1, near: 0,
      see: (x, y) => [
        (x / facts.resolution - camera.x) / camera.scale, (y / facts.resolution - camera.y) / camera.scale, 1,
      ],
    };
  }

  /** Pixels of the screen in one of the page. */
  private ratio(): number {
    return this.canvas.width / Math.max(this.canvas.clientWidth, 1);
  }

  private palette(): Palette {
    return paletteOf(this.store.value, isDark(this.root));
  }

  private changed(): void {
    this.panel.update(this.palette());
    this.frames.schedule();
  }

  private resize(): void {
    const size = pixelsOf(this.canvas);
    if (!size) return;
    // Whoever looks at the whole map goes on doing so.
    const whole = this.camera.isFitted();
    Object.assign(this.canvas, size);
    this.camera.resize(size.width, size.height);
    if (whole) this.camera.fit();
    this.frames.schedule();
  }

  private draw(): void {
    this.layer.draw(this.camera, this.store.value, this.palette());
    this.describe();
    this.afterDraw?.();
  }

  /** Say where the pointer is, what is there, and how long things are. */
  private describe(): void {
    const { camera, facts } = this;
    const ratio = this.ratio();
    const inPixel = camera.scale * ratio * facts.resolution;
    const length = roundLength(inPixel, SCALE_BAR);
    this.bar.textContent = lengthInWords(length);
    this.bar.style.width = `${length / inPixel}px`;
    const at = this.byKeys ? ([camera.width / 2, camera.height / 2] as const) : this.pointer;
    this.words.setAttribute("aria-live", this.byKeys ? "polite" : "off");
    if (!at) {
      this.position.textContent = "";
      this.words.replaceChildren("Point at a cell to see what is known of it.");
      this.frame.hidden = true;
      return;
    }
    const [x, y] = camera.at(...at);
    this.position.textContent =
      `x ${metres(x * facts.resolution, facts.resolution)} m, y ${metres(y * facts.resolution, facts.resolution)} m`;
    const cell = this.cellAt(x, y);
    this.words.replaceChildren(...describe(facts, this.store.value, cell).map((line) => element("div", {}, line)));
    this.frameAround(cell, ratio);
  }

  /** The cell that is shown at a place; where walls are kept from afar, the one of the map itself. */
  private cellAt(x: number, y: number): Cell {
    const shown = shownAt(this.pyramid, this.store.value, this.camera.scale);
    const level = this.pyramid.levels[shown.block > 1 ? 0 : shown.level]!;
    const [column, row] = [Math.floor(x / level.factor), Math.floor(y / level.factor)];
    const [hits, passes] = votesAt(this.pyramid, level, column, row);
    return { x: column, y: row, factor: level.factor, hits, passes };
  }

  private frameAround(cell: Cell, ratio: number): void {
    const { camera } = this;
    const side = cell.factor / camera.scale / ratio;
    this.frame.hidden = side < FRAMED_FROM;
    if (this.frame.hidden) return;
    const left = ((cell.x * cell.factor - camera.x) / camera.scale + camera.width / 2) / ratio;
    const below = (((cell.y + 1) * cell.factor - camera.y) / camera.scale - camera.height / 2) / ratio;
    Object.assign(this.frame.style, {
      width: `${side}px`, height: `${side}px`, transform: `translate(${left}px, ${-below}px)`,
    });
  }
}

export type AnyViewer = Viewer | SpaceViewer;

/** Show a map in an element of a page, with the way of its log where that is given. */
export async function mount(root: HTMLElement, payload: Payload, journey: Journey | null = null): Promise<AnyViewer> {
  const { facts } = payload;
  const viewer = facts.kind === "space"
    ? await inSpace(root, payload as Payload<SpaceFacts>)
    : new Viewer(root, facts, await pyramidOf(payload as Payload<PlaneFacts>));
  if (journey) viewer.log = new LogView(viewer, journey);
  return viewer;
}

const inSpace = async (root: HTMLElement, payload: Payload<SpaceFacts>): Promise<SpaceViewer> =>
  new SpaceViewer(root, payload, await voxelsOf(payload));
