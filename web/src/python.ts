// SPDX-License-Identifier: Apache-2.0
// The view that is on the screen, as Python makes it: in a notebook the map is `grid`, not a file.

import type { Facts } from "./payload";
import { isProbability } from "./posterior";
import { type Settings, settingsOf } from "./settings";

export function pythonOf(facts: Facts, set: Settings): string {
  const own = settingsOf(facts);
  const words: string[] = [];
  const given = (name: string, value: number, usual: number): void => {
    if (value !== usual) words.push(`${name}=${value}`);
  };
  if (!isProbability(set.posterior)) {
    given("a", set.betaA, own.betaA);
    given("b", set.betaB, own.betaB);
    const view = `grid.reflection(${words.join(", ")})`;
    return set.posterior === "interval-width" ? `${view}.plot(show="interval-width")` : view;
  }
  if (set.posterior === "calibrated") {
    given("prior", set.fittedPrior, own.fittedPrior);
  } else {
    given("p_hit", set.pHit, own.pHit);
    given("p_miss", set.pMiss, own.pMiss);
    given("prior", set.prior, own.prior);
  }
  if (set.free !== own.free || set.occupied !== own.occupied) {
    words.push(`thresholds=oddsmap.Thresholds(${set.free}, ${set.occupied})`);
  }
  if (set.clamped) words.push(`clamp=(${set.clampLow}, ${set.clampHigh})`);
  return `grid.${set.posterior === "calibrated" ? "calibrated" : "log_odds"}(${words.join(", ")})`;
}
