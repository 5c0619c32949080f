// SPDX-License-Identifier: Apache-2.0
// What a person chose: how evidence becomes a posterior, and how that is shown.

import type { Facts } from "./payload";

/** A posterior of counts, or one of the maps of probabilities of the page, by its number. */
export type PosteriorName = "log-odds" | "calibrated" | "reflection" | "interval-width" | `given${number}`;

export interface Settings {
  posterior: PosteriorName;
  /** Each value in its own colour, or the states that thresholds decide. */
  colours: "values" | "states";
  /** A cell on the screen that is many of the map: their evidence added up, or their walls kept. */
  fromAfar: "sums" | "walls";
  pHit: number;
  pMiss: number;
  prior: number;
  /** As `prior`, of the calibrated posterior. */
  fittedPrior: number;
  free: number;
  occupied: number;
  clamped: boolean;
  clampLow: number;
  clampHigh: number;
  betaA: number;
  betaB: number;
  /** Whether they are shown. */
  landmarks: boolean;
  /** What the colour of a voxel says. */
  paint: "height" | "probability" | "hits";
  /** What a drag turns around: the middle of the screen, or the eye. */
  drag: "orbit" | "fly";
  /** The clip box of a 3D map [m]. */
  xLow: number;
  xHigh: number;
  yLow: number;
  yHigh: number;
  zLow: number;
  zHigh: number;
}

export type NumberName =
  | "pHit" | "pMiss" | "prior" | "fittedPrior" | "free" | "occupied" | "clampLow" | "clampHigh" | "betaA" | "betaB"
  | "xLow" | "xHigh" | "yLow" | "yHigh" | "zLow" | "zHigh";

/** Where a map begins and ends along an axis [m]. */
export const spanOf = (facts: Facts, axis: 0 | 1 | 2): [number, number] =>
  [(facts.lo[axis] ?? 0) * facts.resolution, (facts.hi[axis] ?? 0) * facts.resolution];

/** What the map itself says. */
export function settingsOf(facts: Facts): Settings {
  const [[xLow, xHigh], [yLow, yHigh], [zLow, zHigh]] = [spanOf(facts, 0), spanOf(facts, 1), spanOf(facts, 2)];
  return {
    posterior: facts.counts ? "log-odds" : "given0",
    colours: "values",
    fromAfar: "walls",
    // Without counts nothing depends on these.
    pHit: facts.p_hit ?? 0.7,
    pMiss: facts.p_miss ?? 0.4,
    prior: facts.prior ?? 0.5,
    fittedPrior: facts.calibrated?.share ?? facts.prior ?? 0.5,
    free: facts.free,
    occupied: facts.occupied,
    clamped: false,
    clampLow: 0.1192,
    clampHigh: 0.971,
    betaA: 1,
    betaB: 1,
    landmarks: true,
    paint: "height",
    drag: "orbit",
    xLow, xHigh, yLow, yHigh, zLow, zHigh,
  };
}

/** Settings that tell those who listen of each change. */
export class Store {
  private readonly listeners: (() => void)[] = [];

  constructor(private current: Settings) {}

  get value(): Readonly<Settings> {
    return this.current;
  }

  set(change: Partial<Settings>): void {
    this.current = { ...this.current, ...change };
    for (const listener of this.listeners) listener();
  }

  listen(listener: () => void): void {
    this.listeners.push(listener);
  }
}
