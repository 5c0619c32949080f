// SPDX-License-Identifier: Apache-2.0
// Landmarks on top of a 2D map: a dot where each is, and the ellipse that holds it with 95 %.

import type { Camera } from "./camera";
import { element } from "./dom";
import type { Facts, Landmark } from "./payload";
import { cellsOf } from "./place";
import { count, metres, short } from "./words";

/** Of dots and of how near a pointer has to be [pixels of the page]. */
const RADIUS = 3.5;
const NEAR = 12;
/** More names than these cover each other. */
const NAMED = 80;
const CORNERS = 48;

const colourOf = (night: boolean): string => (night ? "#8cc8ff" : "#1f5f99");

interface Drawn {
  readonly mark: Landmark;
  /** In cells: the middle and the ellipse around it, x and y one after the other. */
  readonly x: number;
  readonly y: number;
  readonly outline: Float64Array;
}

export class LandmarkLayer {
  readonly canvas = element("canvas", { class: "over", "aria-hidden": true });
  private readonly drawn: readonly Drawn[];

  constructor(private readonly facts: Facts) {
    this.drawn = (facts.landmarks ?? []).map((mark) => {
      const [x, y] = cellsOf(facts, mark.mean[0]!, mark.mean[1]!);
      const [longer, shorter, angle] = mark.ellipse;
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      const outline = new Float64Array(2 * CORNERS);
      for (let i = 0; i < CORNERS; i++) {
        const [along, across] = [longer * Math.cos((2 * Math.PI * i) / CORNERS), shorter * Math.sin((2 * Math.PI * i) / CORNERS)];
        outline.set(cellsOf(facts, mark.mean[0]! + c * along - s * across, mark.mean[1]! + s * along + c * across), 2 * i);
      }
      return { mark, x, y, outline };
    });
  }

  get isEmpty(): boolean {
    return this.drawn.length === 0;
  }

  /** The box around a map and its landmarks, in cells. */
  around(lo: readonly [number, number], hi: readonly [number, number]): { lo: [number, number]; hi: [number, number] } {
    const box = { lo: [...lo] as [number, number], hi: [...hi] as [number, number] };
    for (const { x, y } of this.drawn) {
      box.lo = [Math.min(box.lo[0], x), Math.min(box.lo[1], y)];
      box.hi = [Math.max(box.hi[0], x), Math.max(box.hi[1], y)];
    }
    return box;
  }

  /** @param ratio pixels of the screen in one of the page. */
  draw(camera: Camera, ratio: number, night: boolean, chosen: Landmark | null): void {
    const pen = this.canvas.getContext("2d")!;
    if (this.canvas.width !== camera.width || this.canvas.height !== camera.height) {
      Object.assign(this.canvas, { width: camera.width, height: camera.height });
    }
    pen.clearRect(0, 0, camera.width, camera.height);
    const colour = colourOf(night);
    const halo = night ? "#0c1117" : "#ffffff";
    const seen = this.drawn.filter((one) => this.reaches(camera, one));
    pen.lineJoin = "round";
    for (const one of seen) {
      pen.beginPath();
      for (let i = 0; i < CORNERS; i++) pen.lineTo(...pixelOf(camera, one.outline[2 * i]!, one.outline[2 * i + 1]!));
      pen.closePath();
      pen.fillStyle = `${colour}38`;
      pen.fill();
      pen.strokeStyle = colour;
      pen.lineWidth = ratio * (one.mark === chosen ? 2.5 : 1.2);
      pen.stroke();
    }
    pen.font = `${12 * ratio}px system-ui, sans-serif`;
    for (const one of seen) {
      const [right, down] = pixelOf(camera, one.x, one.y);
      pen.beginPath();
      pen.arc(right, down, ratio * (one.mark === chosen ? RADIUS + 1.5 : RADIUS), 0, 2 * Math.PI);
      pen.fillStyle = colour;
      pen.strokeStyle = halo;
      pen.lineWidth = ratio;
      pen.fill();
      pen.stroke();
      if (seen.length > NAMED && one.mark !== chosen) continue;
      pen.lineWidth = 3 * ratio;
      pen.strokeText(one.mark.id, right + 6 * ratio, down - 6 * ratio);
      pen.fillStyle = night ? "#e6ebf0" : "#1b222b";
      pen.fillText(one.mark.id, right + 6 * ratio, down - 6 * ratio);
    }
  }

  /** The landmark at a pixel: the nearest that is near, or whose ellipse holds it. */
  at(camera: Camera, ratio: number, right: number, down: number): Landmark | null {
    let found: Landmark | null = null;
    let least = Infinity;
    const [x, y] = camera.at(right, down);
    for (const { mark, x: column, y: row } of this.drawn) {
      const distance = Math.hypot(x - column, y - row);
      if (distance >= least || (distance > NEAR * ratio * camera.scale && !this.holds(mark, x - column, y - row))) continue;
      [found, least] = [mark, distance];
    }
    return found;
  }

  private holds(mark: Landmark, dx: number, dy: number): boolean {
    const [longer, shorter, angle] = mark.ellipse;
    const turned = angle - this.facts.yaw;
    const [c, s] = [Math.cos(turned), Math.sin(turned)];
    const { resolution } = this.facts;
    return Math.hypot((c * dx + s * dy) / longer, (c * dy - s * dx) / shorter) * resolution <= 1;
  }

  /** Whether some of it may be on the screen. */
  private reaches(camera: Camera, { mark, x, y }: Drawn): boolean {
    const [right, down] = pixelOf(camera, x, y);
    const reach = mark.ellipse[0] / this.facts.resolution / camera.scale + 60;
    return right > -reach && down > -reach && right < camera.width + reach && down < camera.height + reach;
  }
}

const pixelOf = (camera: Camera, x: number, y: number): [number, number] => [
  (x - camera.x) / camera.scale + camera.width / 2, (camera.y - y) / camera.scale + camera.height / 2,
];

/** What dots and ellipses stand for. */
export const landmarkLegend = (): HTMLElement[] => ([["dot", "landmark"], ["ring", "its 95 % ellipse"]] as const)
  .map(([shape, text]) => element("span", { class: "entry" }, element("span", { class: `swatch ${shape}` }), text));

/** What is known of a landmark: a line each. */
export function describeLandmark(facts: Facts, mark: Landmark): string[] {
  const place = mark.mean.map((value, axis) => `${"xyz"[axis]} ${metres(value, facts.resolution)} m`).join(", ");
  const [longer, shorter] = mark.ellipse;
  return [
    `landmark ${mark.id}, ${count(mark.count)} ${mark.count === 1 ? "observation" : "observations"}`, place,
    `95 % ellipse: semi-axes ${short(longer)} and ${short(shorter)} m`,
  ];
}
