// SPDX-License-Identifier: Apache-2.0
// What a person chose: how evidence becomes a posterior, and how that is shown.

import type { PlaneFacts } from "./payload";

export type PosteriorName = "log-odds" | "calibrated" | "reflection" | "interval-width";

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
}

export type NumberName =
  | "pHit" | "pMiss" | "prior" | "fittedPrior" | "free" | "occupied" | "clampLow" | "clampHigh" | "betaA" | "betaB";

/** What the map itself says. */
export function settingsOf(facts: PlaneFacts): Settings {
  return {
    posterior: "log-odds",
    colours: "values",
    fromAfar: "walls",
    pHit: facts.p_hit,
    pMiss: facts.p_miss,
    prior: facts.prior,
    fittedPrior: facts.calibrated?.share ?? facts.prior,
    free: facts.free,
    occupied: facts.occupied,
    clamped: false,
    clampLow: 0.1192,
    clampHigh: 0.971,
    betaA: 1,
    betaB: 1,
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
