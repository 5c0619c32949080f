// SPDX-License-Identifier: Apache-2.0
// From cells to the world and back.

import type { Facts } from "./payload";

/** Where a point lies [m], of its position in cells. */
export function placeOf(facts: Facts, x: number, y: number): [number, number] {
  const { corner, yaw, resolution } = facts;
  const [c, s] = [Math.cos(yaw) * resolution, Math.sin(yaw) * resolution];
  return [corner[0] + c * x - s * y, corner[1] + s * x + c * y];
}

/** The position in cells of a point [m]. */
export function cellsOf(facts: Facts, x: number, y: number): [number, number] {
  const { corner, yaw, resolution } = facts;
  const [dx, dy] = [(x - corner[0]) / resolution, (y - corner[1]) / resolution];
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  return [c * dx + s * dy, c * dy - s * dx];
}
