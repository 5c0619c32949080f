// SPDX-License-Identifier: Apache-2.0
// The `oddsmap export` command that writes what is on the screen.

import type { Facts } from "./payload";
import { isProbability } from "./posterior";
import { type Settings, settingsOf } from "./settings";

/** A word as a shell reads it. */
export const quoted = (word: string): string =>
  /^[\w@%+=:,./-]+$/.test(word) && !word.startsWith("-") ? word : `'${word.replaceAll("'", `'"'"'`)}'`;

export function commandOf(facts: Facts, set: Settings): string {
  const own = settingsOf(facts);
  const stem = facts.name.replace(/\.zarr$/i, "") || "map";
  const space = facts.kind === "space";
  const states = space || (set.colours === "states" && isProbability(set.posterior));
  const suffix = space ? ".ply" : states ? ".yaml" : ".png";
  const words = ["oddsmap", "export", quoted(facts.name), quoted(`${stem}${suffix}`)];
  const option = (name: string, value: number, usual: number): void => {
    if (value !== usual) words.push(name, String(value));
  };
  if (set.posterior === "calibrated") words.push("--posterior", "calibrated");
  if (set.posterior === "log-odds") {
    option("--p-hit", set.pHit, own.pHit);
    option("--p-miss", set.pMiss, own.pMiss);
    option("--prior", set.prior, own.prior);
  } else if (set.posterior === "calibrated") {
    option("--prior", set.fittedPrior, own.fittedPrior);
  } else {
    words.push("--posterior", "reflection");
    if (set.posterior === "interval-width") words.push("--show", "interval-width");
    option("--beta-a", set.betaA, own.betaA);
    option("--beta-b", set.betaB, own.betaB);
  }
  if (isProbability(set.posterior) && set.clamped) {
    words.push("--clamp", String(set.clampLow), String(set.clampHigh));
  }
  if (states) {
    if (!space) option("--free", set.free, own.free);
    option("--occupied", set.occupied, own.occupied);
  }
  return words.join(" ");
}
