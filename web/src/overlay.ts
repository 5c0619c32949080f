// SPDX-License-Identifier: Apache-2.0
// Lines and marks above a map, flat or in space: a canvas of its own, drawn anew for each picture.

import { element } from "./dom";

/** How points of the map get to the screen: `see` turns a point into right, up and ahead of the eye;
 * it shows at `focal` times right and up over ahead, from the middle. */
export interface Eye {
  /** Pixels of the screen. */
  readonly width: number;
  readonly height: number;
  /** Pixels of the screen in one of the page. */
  readonly ratio: number;
  readonly focal: number;
  /** What is not so far ahead is not drawn. */
  readonly near: number;
  see(x: number, y: number, z: number): [number, number, number];
}

type Seen = [number, number, number];

export interface Stroke {
  readonly colour: string;
  /** Pixels of the page. */
  readonly width: number;
  readonly opacity?: number;
  /** Around the line, so that it shows on any ground. */
  readonly casing?: string;
  readonly dashed?: boolean;
}

export class Overlay {
  readonly canvas = element("canvas", { class: "overlay", "aria-hidden": true });
  private readonly context = this.canvas.getContext("2d")!;
  private eye!: Eye;

  /** Begin a picture. */
  begin(eye: Eye): void {
    this.eye = eye;
    if (this.canvas.width !== eye.width || this.canvas.height !== eye.height) {
      Object.assign(this.canvas, { width: eye.width, height: eye.height });
    }
    this.context.clearRect(0, 0, eye.width, eye.height);
    Object.assign(this.context, { lineJoin: "round", lineCap: "round" });
  }

  /** Where a point shows; null: behind the eye. */
  screen(x: number, y: number, z: number): [number, number] | null {
    const seen = this.eye.see(x, y, z);
    return seen[2] > this.eye.near ? this.shown(seen) : null;
  }

  /** A line through points: three coordinates each; NaN breaks it. */
  way(points: Float64Array, stroke: Stroke): void {
    const path = new Path2D();
    let before: Seen | null = null;
    let [lastX, lastY] = [NaN, NaN];
    for (let i = 0; i < points.length; i += 3) {
      if (!(points[i]! === points[i]!)) {
        before = null;
        continue;
      }
      const seen = this.eye.see(points[i]!, points[i + 1]!, points[i + 2]!);
      const ahead = seen[2] > this.eye.near;
      if (before && ahead && before[2] > this.eye.near) {
        const [x, y] = this.shown(seen);
        // A long way is many points in few pixels.
        if (Math.abs(x - lastX) + Math.abs(y - lastY) < 1 && i + 3 < points.length) continue;
        path.lineTo((lastX = x), (lastY = y));
      } else if (before) {
        this.segment(path, before, seen);
        if (ahead) [lastX, lastY] = this.shown(seen);
      } else if (ahead) {
        [lastX, lastY] = this.shown(seen);
        path.moveTo(lastX, lastY);
      }
      before = seen;
    }
    this.draw(path, stroke);
  }

  /** Lines from starts to ends, those that `chosen` names. */
  lines(
    starts: ArrayLike<number>, ends: ArrayLike<number>, chosen: (line: number) => boolean, stroke: Stroke,
  ): void {
    const path = new Path2D();
    for (let i = 0; 3 * i < starts.length; i++) {
      if (!chosen(i)) continue;
      this.segment(path, this.eye.see(starts[3 * i]!, starts[3 * i + 1]!, starts[3 * i + 2]!),
        this.eye.see(ends[3 * i]!, ends[3 * i + 1]!, ends[3 * i + 2]!));
    }
    this.draw(path, stroke);
  }

  /** A dot of a radius [pixels of the page] at each point that `chosen` names. */
  dots(points: ArrayLike<number>, chosen: (point: number) => boolean, radius: number, colour: string): void {
    const { context } = this;
    context.fillStyle = colour;
    context.beginPath();
    const r = radius * this.eye.ratio;
    for (let i = 0; 3 * i < points.length; i++) {
      const at = chosen(i) && this.screen(points[3 * i]!, points[3 * i + 1]!, points[3 * i + 2]!);
      if (!at) continue;
      context.moveTo(at[0] + r, at[1]);
      context.arc(at[0], at[1], r, 0, 2 * Math.PI);
    }
    context.fill();
  }

  /** A closed shape around a point of the screen: corners in pixels of the page, turned by an angle. */
  shape(at: readonly [number, number], corners: readonly (readonly [number, number])[], turned: number,
    fill: string, edge: string): void {
    const { context, eye } = this;
    const [c, s] = [Math.cos(turned) * eye.ratio, Math.sin(turned) * eye.ratio];
    const path = new Path2D();
    for (const [x, y] of corners) path.lineTo(at[0] + c * x - s * y, at[1] + s * x + c * y);
    path.closePath();
    context.lineWidth = 3 * eye.ratio;
    context.strokeStyle = edge;
    context.stroke(path);
    context.fillStyle = fill;
    context.fill(path);
  }

  /** A ring, or a filled circle, with a word at its right or at its left. */
  mark(
    at: readonly [number, number], word: string, side: "left" | "right", filled: boolean, colour: string, edge: string,
  ): void {
    const { context, eye } = this;
    const path = new Path2D();
    path.arc(at[0], at[1], 5 * eye.ratio, 0, 2 * Math.PI);
    this.draw(path, { colour, width: 2.5, casing: edge });
    context.fillStyle = filled ? colour : edge;
    context.fill(path);
    context.font = `600 ${12 * eye.ratio}px system-ui, sans-serif`;
    context.lineWidth = 3.5 * eye.ratio;
    context.strokeStyle = edge;
    context.textAlign = side === "right" ? "left" : "right";
    const [x, y] = [at[0] + (side === "right" ? 10 : -10) * eye.ratio, at[1] + 4 * eye.ratio];
    context.strokeText(word, x, y);
    context.fillStyle = colour;
    context.fillText(word, x, y);
  }

  private shown(seen: Seen): [number, number] {
    const { width, height, focal } = this.eye;
    return [width / 2 + (focal * seen[0]) / seen[2], height / 2 - (focal * seen[1]) / seen[2]];
  }

  /** Add what lies ahead of a line. */
  private segment(path: Path2D, from: Seen, to: Seen): void {
    const near = this.eye.near * 1.01;
    if (from[2] <= near && to[2] <= near) return;
    const cut = (a: Seen, b: Seen): Seen => {
      if (a[2] > near) return a;
      const share = (near - a[2]) / (b[2] - a[2]);
      return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), near];
    };
    path.moveTo(...this.shown(cut(from, to)));
    path.lineTo(...this.shown(cut(to, from)));
  }

  private draw(path: Path2D, stroke: Stroke): void {
    const { context, eye } = this;
    context.globalAlpha = stroke.opacity ?? 1;
    context.setLineDash(stroke.dashed ? [4 * eye.ratio, 4 * eye.ratio] : []);
    if (stroke.casing) {
      context.lineWidth = (stroke.width + 2.5) * eye.ratio;
      context.strokeStyle = stroke.casing;
      context.stroke(path);
    }
    context.lineWidth = stroke.width * eye.ratio;
    context.strokeStyle = stroke.colour;
    context.stroke(path);
    context.globalAlpha = 1;
    context.setLineDash([]);
  }
}
