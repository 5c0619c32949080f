// SPDX-License-Identifier: Apache-2.0
// Lines over a 3D map: around the voxel that is pointed at, and the directions of the axes. They cost no
// frame of the map.

import { drawn } from "./dom";
import type { SpaceCamera, Vector } from "./space_camera";

/** A voxel is framed at least so large [pixels of the page]. */
const SMALLEST_FRAME = 8;
/** Length of an axis that lies in the plane of the screen [pixels of the page]. */
const AXIS = 26;

export class SpaceOverlay {
  private readonly edges = drawn("path", { class: "edges" });
  readonly root = drawn("svg", { class: "overlay", "aria-hidden": true }, this.edges);
  private readonly lines = ["x", "y", "z"].map((name) => ({
    line: drawn("line", { class: name }), name: drawn("text", {}, document.createTextNode(name)),
  }));
  readonly axes = drawn("svg", { class: "axes", "aria-hidden": true, viewBox: "-40 -40 80 80" },
    ...this.lines.flatMap(({ line, name }) => [line, name]));

  /** Show where the axes of the map point. */
  turn(camera: SpaceCamera): void {
    const [right, up] = camera.axes();
    this.lines.forEach(({ line, name }, axis) => {
      const [x, y] = [right[axis]!, -up[axis]!];
      line.setAttribute("x2", (AXIS * x).toFixed(1));
      line.setAttribute("y2", (AXIS * y).toFixed(1));
      name.setAttribute("x", ((AXIS + 8) * x).toFixed(1));
      name.setAttribute("y", ((AXIS + 8) * y).toFixed(1));
    });
  }

  /**
   * Frame a voxel.
   *
   * @param voxel counted from the first cell of the map; null: none.
   * @param ratio pixels of the screen in one of the page.
   */
  frame(camera: SpaceCamera, voxel: Vector | null, ratio: number): void {
    this.edges.setAttribute("d", voxel ? outline(camera, voxel, ratio) : "");
  }
}

/** The faces of a voxel that look at the eye; of a small one a square around it. */
function outline(camera: SpaceCamera, voxel: Vector, ratio: number): string {
  const eye = camera.eye();
  const corner = (at: number): Vector =>
    camera.seen(voxel.map((x, axis) => x + ((at >> axis) & 1))) as Vector;
  const corners = Array.from({ length: 8 }, (_, at) => corner(at));
  if (corners.some(([, , depth]) => depth <= 0)) return "";
  const [xs, ys] = [0, 1].map((i) => corners.map((one) => one[i]! / ratio)) as [number[], number[]];
  const [left, right, top, bottom] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  if (Math.max(right - left, bottom - top) < SMALLEST_FRAME) {
    const half = SMALLEST_FRAME / 2;
    const [x, y] = [(left + right) / 2 - half, (top + bottom) / 2 - half].map((n) => n.toFixed(1));
    return `M${x} ${y}h${2 * half}v${2 * half}h${-2 * half}z`;
  }
  const faces: string[] = [];
  for (let axis = 0; axis < 3; axis++) {
    const side = eye[axis]! > voxel[axis]! + 1 ? 1 : eye[axis]! < voxel[axis]! ? 0 : null;
    if (side === null) continue;
    const [u, v] = [1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3)];
    const around = [0, u, u | v, v].map((at) => at | (side << axis));
    faces.push(`M${around.map((at) => `${xs[at]!.toFixed(1)} ${ys[at]!.toFixed(1)}`).join("L")}z`);
  }
  return faces.join("");
}
