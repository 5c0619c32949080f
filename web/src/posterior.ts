// SPDX-License-Identifier: Apache-2.0
// The posteriors of one cell, in double precision: what is said of the cell under the cursor.
// `posterior_shader.ts` has the same for every pixel.

import { betaInterval } from "./beta";
import { givenOf } from "./given";
import type { CountModel, Facts } from "./payload";
import type { PosteriorName, Settings } from "./settings";

/** Mass of credible intervals. */
export const LEVEL = 0.95;

export const logit = (p: number): number => Math.log(p) - Math.log1p(-p);

export function sigmoid(x: number): number {
  const small = Math.exp(-Math.abs(x));
  return (x >= 0 ? 1 : small) / (1 + small);
}

/** Whether a posterior is the probability that a cell is occupied. */
export const isProbability = (name: PosteriorName): boolean =>
  name !== "reflection" && name !== "interval-width";

/** Whether a posterior is worked out from hits and passes; else it came with the page. */
export const isOfCounts = (name: PosteriorName): boolean => !name.startsWith("given");

/** The value that a posterior shows of a cell, between 0 and 1. */
export function valueOf(facts: Facts, set: Settings, hits: number, passes: number): number {
  const alpha = set.betaA + hits;
  const beta = set.betaB + passes;
  switch (set.posterior) {
    case "log-odds":
      return sigmoid(clamped(logit(set.prior) + logit(set.pHit) * hits + logit(set.pMiss) * passes, set));
    case "calibrated":
      return sigmoid(clamped(logit(set.fittedPrior) + factorOf(facts.calibrated!, hits, passes), set));
    case "reflection":
      return alpha / (alpha + beta);
    case "interval-width": {
      const [low, high] = betaInterval(alpha, beta, LEVEL);
      return high - low;
    }
    default:
      return givenOf(facts, set.posterior)!.values[hits]!;
  }
}

function clamped(logOdds: number, set: Settings): number {
  if (!set.clamped) return logOdds;
  return Math.min(Math.max(logOdds, logit(set.clampLow)), logit(set.clampHigh));
}

/** The log Bayes factor of `oddsmap.posterior.count_model.CountModel`. */
export function factorOf(model: CountModel, hits: number, passes: number): number {
  if (hits === 0 && passes === 0) return 0;
  const knots = model.distributions.length;
  const place = Math.min(Math.log2(1 + hits + passes), knots - 1);
  const below = Math.min(Math.floor(place), knots - 2);
  const share = place - below;
  const logs = model.log_reflect.map((r, j) => hits * r + passes * model.log_miss[j]!);
  const best = Math.max(...logs);
  let yes = 0;
  let no = 0;
  logs.forEach((log, j) => {
    const prior =
      (1 - share) * model.distributions[below]![j]! + share * model.distributions[below + 1]![j]!;
    const joint = prior * Math.exp(log - best);
    yes += model.occupied[j]! * joint;
    no += (1 - model.occupied[j]!) * joint;
  });
  return Math.log(yes) - Math.log(no) - logit(model.share);
}

export type State = "unknown" | "free" | "undecided" | "occupied";

export function stateOf(set: Settings, probability: number, seen: boolean): State {
  if (!seen) return "unknown";
  if (probability >= set.occupied) return "occupied";
  return probability <= set.free ? "free" : "undecided";
}
