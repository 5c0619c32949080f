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
  paint: "height" | "probability" | "hits" | "reflection" | "interval-width";
  /** Which voxels are drawn, those that are not occupied as points: also free, or also undecided ones. */
  voxels: "occupied" | "free" | "known";
  /** Of these points. */
  opacity: number;
  /** Whether there is a horizontal slice, and at which height [m]. */
  sliced: boolean;
  sliceAt: number;
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

/** Whether the share of beams that are reflected is shown, or how uncertain it is. */
export const showsShare = (set: Settings): boolean =>
  [set.posterior, set.paint].some((name) => name === "reflection" || name === "interval-width");

/** Whether free space is drawn, as points: that of counts, of which alone it is known. */
export const showsAir = (set: Settings): boolean => set.voxels !== "occupied" && !set.posterior.startsWith("given");

/** Whether there is a slice, which needs free space, too. */
export const isSliced = (set: Settings): boolean => set.sliced && !set.posterior.startsWith("given");

export type NumberName =
  | "pHit" | "pMiss" | "prior" | "fittedPrior" | "free" | "occupied" | "clampLow" | "clampHigh" | "betaA" | "betaB"
  | "opacity" | "sliceAt" | "xLow" | "xHigh" | "yLow" | "yHigh" | "zLow" | "zHigh";

/** Where a map begins and ends along an axis [m]. */
export const spanOf = (facts: Facts, axis: 0 | 1 | 2): [number, number] =>
  [(facts.lo[axis] ?? 0) * facts.resolution, (facts.hi[axis] ?? 0) * facts.resolution];

/** What the map itself says. */
export function settingsOf(facts: Facts): Settings {
  const [[xLow, xHigh], [yLow, yHigh], [zLow, zHigh]] = [spanOf(facts, 0), spanOf(facts, 1), spanOf(facts, 2)];
  return {
    posterior: facts.counts ? "log-odds" : "given0",
    colours: facts.kind === "space" ? "states" : "values",
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
    voxels: "occupied",
    opacity: 0.05,
    sliced: false,
    sliceAt: (zLow + zHigh) / 2,
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
