// SPDX-License-Identifier: Apache-2.0
// A map with its log: the way of the sensors, one scan at a time, and who voted on a cell.

import { element } from "./dom";
import { isDark } from "./heading";
import { type Beams, inSpace, type Journey } from "./journey";
import { type Eye, Overlay } from "./overlay";
import type { Facts } from "./payload";
import { TimeBar } from "./time_bar";
import { Why } from "./why";

/** A viewer that shows a log above its map. */
export interface Host {
  readonly root: HTMLElement;
  readonly facts: Facts;
  eye(): Eye;
  redraw(): void;
  /** Called with each picture of the map. */
  afterDraw: (() => void) | null;
  /** Called with the cell that somebody asks about. */
  asked: ((cell: readonly number[]) => void) | null;
}

interface Ink {
  readonly way: string;
  readonly beam: string;
  readonly hit: string;
  readonly pass: string;
  readonly edge: string;
}

// Told apart by those who see no red or no green, on white, grey and black alike.
const DAY: Ink = { way: "#0b5cad", beam: "#a3147a", hit: "#d03a12", pass: "#00796b", edge: "#ffffff" };
const NIGHT: Ink = { way: "#7dbaff", beam: "#ff86d3", hit: "#ff8a5c", pass: "#4fe0c6", edge: "#0c1117" };

/** Scans whose beams are remembered. */
const REMEMBERED = 64;
/** Marks with words that lie closer would cover each other: aside and up [pixels of the page]. */
const NEAR = [50, 16] as const;
const ARROW = [[11, 0], [-7, 7], [-3, 0], [-7, -7]] as const;

export class LogView {
  readonly bar: TimeBar;
  readonly why: Why;
  /** The beams of the scan that is shown, once they are there. */
  beams: Beams | null = null;
  private readonly overlay = new Overlay();
  private readonly known = new Map<number, Beams>();
  private readonly ways: readonly { readonly scans: Uint32Array; readonly points: Float64Array }[];
  private wanted = -1;
  private reading = false;

  constructor(private readonly host: Host, readonly journey: Journey) {
    const { root, facts } = host;
    const { resolution } = facts;
    this.ways = journey.ways.map((scans) => ({ scans, points: pointsOf(journey, scans) }));
    this.bar = new TimeBar(journey, resolution, () => this.changed());
    const cell = facts.kind === "space" ? "voxel" : "cell";
    this.why = new Why(journey, resolution,
      `Click a ${cell}, or press Enter on the map for the one in its middle, to learn which scans voted on it.`,
      (scan) => (this.bar.scan = scan), () => host.redraw());
    const map = root.querySelector(".map")!;
    const stage = element("div", { class: "stage" });
    map.replaceWith(stage);
    stage.append(map, this.bar.root);
    const canvas = map.querySelector("canvas")!;
    canvas.after(this.overlay.canvas);
    root.querySelector(".side header")!.after(...this.built(), this.why.root);
    host.afterDraw = () => this.draw();
    host.asked = (index) => void this.why.ask(index);
    canvas.setAttribute("aria-label", `${canvas.getAttribute("aria-label")} Enter asks which scans voted on it.`);
    this.changed();
  }

  /** How the map is made, where it is in no file. */
  private built(): Node[] {
    const { build, log } = this.journey.facts;
    if (build === null) return [];
    return [element("p", { class: "built" }, `Made of ${log} for this page, and in no file. To keep such a map: `,
      element("code", {}, build))];
  }

  private changed(): void {
    const { scan } = this.bar;
    this.why.mark(scan);
    this.beams = this.journey.beams(scan) ?? this.known.get(scan) ?? null;
    if (this.beams) this.bar.say(this.beams);
    else if (this.journey.facts.served) {
      this.wanted = scan;
      void this.read();
    }
    this.host.redraw();
  }

  /** Ask for the beams of the scan that is wanted, one scan at a time. */
  private async read(): Promise<void> {
    if (this.reading) return;
    this.reading = true;
    while (this.wanted >= 0) {
      const scan = this.wanted;
      this.wanted = -1;
      let said: Beams | string;
      try {
        said = await this.fetched(scan);
      } catch (error) {
        said = error instanceof TypeError ? "The log cannot be read: is oddsmap view still running?" : String(error);
      }
      if (typeof said !== "string") {
        this.known.set(scan, said);
        if (this.known.size > REMEMBERED) this.known.delete(this.known.keys().next().value!);
      }
      if (scan === this.bar.scan) {
        this.beams = typeof said === "string" ? null : said;
        this.bar.say(said);
        this.host.redraw();
      }
    }
    this.reading = false;
  }

  private async fetched(scan: number): Promise<Beams | string> {
    const reply = await fetch(`scan?number=${scan}`);
    if (!reply.ok) return `The scan cannot be read: ${(await reply.text()).trim()}`;
    const found = (await reply.json()) as Omit<Beams, "starts" | "ends"> & { starts: number[]; ends: number[] };
    const { axes } = this.journey.facts;
    return { ...found, starts: inSpace(found.starts, axes), ends: inSpace(found.ends, axes) };
  }

  private draw(): void {
    const { overlay, bar, journey } = this;
    const ink = isDark(this.host.root) ? NIGHT : DAY;
    overlay.begin(this.host.eye());
    if (bar.showsWay) this.drawWays(ink);
    if (bar.showsBeams && this.beams) {
      const { starts, ends, returned } = this.beams;
      // Many lines side by side are a face.
      const opacity = Math.min(0.5, Math.max(0.25, 60 / returned.length));
      overlay.lines(starts, ends, (i) => !returned[i], { colour: ink.beam, width: 1, opacity: opacity / 2, dashed: true });
      overlay.lines(starts, ends, (i) => !!returned[i], { colour: ink.beam, width: 1, opacity });
      overlay.dots(ends, (i) => !!returned[i], 2, ink.beam);
    }
    if (bar.showsWay) this.drawMarks(ink);
    this.drawVotes(ink);
    const place = journey.at(bar.scan);
    if (!place) return;
    const { x, y, z, yaw, pitch } = place;
    const at = overlay.screen(x, y, z);
    const [c, s, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    const ahead = overlay.screen(x + c * cp * 0.1, y + s * cp * 0.1, z + sp * 0.1);
    if (at && ahead) overlay.shape(at, ARROW, Math.atan2(ahead[1] - at[1], ahead[0] - at[0]), ink.way, ink.edge);
  }

  private drawWays(ink: Ink): void {
    const { overlay, bar } = this;
    for (const { scans, points } of this.ways) {
      let driven = 0;
      while (driven < scans.length && scans[driven]! <= bar.scan) driven++;
      const stroke = { colour: ink.way, width: 2, casing: ink.edge };
      overlay.way(points.subarray(3 * Math.max(driven - 1, 0)), { colour: ink.way, width: 1.5, opacity: 0.5 });
      overlay.way(points.subarray(0, 3 * driven), stroke);
    }
  }

  /** Where the ways start and end. */
  private drawMarks(ink: Ink): void {
    const { overlay } = this;
    for (const { points } of this.ways) {
      const at = (from: number): readonly [number, number] | null =>
        overlay.screen(points[from]!, points[from + 1]!, points[from + 2]!);
      const [end, start] = [at(points.length - 3), at(0)];
      // One word hides the other where both are near: then the mark at the left has it at its left.
      const ratio = this.host.eye().ratio;
      const close = end && start && Math.abs(end[0] - start[0]) < NEAR[0] * ratio && Math.abs(end[1] - start[1]) < NEAR[1] * ratio;
      const endSide = close && end[0] <= start[0] ? "left" : "right";
      const startSide = close && end[0] > start[0] ? "left" : "right";
      if (end) overlay.mark(end, "end", endSide, true, ink.way, ink.edge);
      if (start) overlay.mark(start, "start", startSide, false, ink.way, ink.edge);
    }
  }

  /** The cell that was asked about, and the beams that voted on it. */
  private drawVotes(ink: Ink): void {
    const { overlay, why, bar } = this;
    const chosen = why.voting.some(({ scan }) => scan === bar.scan);
    for (const strong of chosen ? [false, true] : [true]) {
      for (const { scan, starts, ends, hit } of why.voting) {
        if (chosen && (scan === bar.scan) !== strong) continue;
        const opacity = strong ? (chosen ? 1 : 0.6) : 0.3;
        const width = chosen && strong ? 2.5 : 1;
        overlay.lines(starts, ends, (i) => !hit[i]!, { colour: ink.pass, width, opacity });
        overlay.lines(starts, ends, (i) => hit[i]!, { colour: ink.hit, width, opacity });
        overlay.dots(ends, (i) => hit[i]!, strong && chosen ? 3 : 2, ink.hit);
      }
    }
    if (why.cell) this.drawCell(why.cell, ink);
  }

  private drawCell(cell: readonly number[], ink: Ink): void {
    const { resolution } = this.host.facts;
    const corners: [number, number, number][] = [];
    for (let corner = 0; corner < 1 << cell.length; corner++) {
      corners.push([0, 1, 2].map((axis) => ((cell[axis] ?? 0) + ((corner >> axis) & 1)) * resolution) as [number, number, number]);
    }
    const edges = corners.flatMap((_, from) => [1, 2, 4].filter((bit) => bit < corners.length && !(from & bit))
      .map((bit) => [corners[from]!, corners[from | bit]!] as const));
    const flat = (end: 0 | 1): number[] => edges.flatMap((edge) => edge[end]);
    if (cell.length === 2) for (const corner of corners) corner[2] = 0;
    this.overlay.lines(flat(0), flat(1), () => true, { colour: ink.hit, width: 2, casing: ink.edge });
  }
}

/** Where the scans of a sensor were; NaN where nobody knows. */
function pointsOf(journey: Journey, scans: Uint32Array): Float64Array {
  const points = new Float64Array(3 * scans.length);
  scans.forEach((scan, i) => {
    const place = journey.at(scan);
    points.set(place ? [place.x, place.y, place.z] : [NaN, NaN, NaN], 3 * i);
  });
  return points;
}
