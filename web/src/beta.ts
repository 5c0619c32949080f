// SPDX-License-Identifier: Apache-2.0
// Quantiles of Beta distributions, for credible intervals.

/** log Gamma(x), x > 0: Stirling's series, which is exact to the last digits from 12 on. */
function logGamma(x: number): number {
  let below = 0;
  for (; x < 12; x++) below += Math.log(x);
  const inverse = 1 / (x * x);
  const series = (1 / 12 - inverse * (1 / 360 - inverse * (1 / 1260 - inverse / 1680))) / x;
  return (x - 0.5) * Math.log(x) - x + 0.5 * Math.log(2 * Math.PI) + series - below;
}

/** The continued fraction of the incomplete Beta function (DLMF 8.17.22), by Lentz's method. */
function fraction(a: number, b: number, x: number): number {
  const tiny = 1e-300;
  let c = 1;
  let d = 1 - ((a + b) * x) / (a + 1);
  d = 1 / (Math.abs(d) < tiny ? tiny : d);
  let value = d;
  for (let m = 1; m < 10_000; m++) {
    const even = (m * (b - m) * x) / ((a + 2 * m - 1) * (a + 2 * m));
    d = 1 + even * d;
    c = 1 + even / c;
    d = 1 / (Math.abs(d) < tiny ? tiny : d);
    c = Math.abs(c) < tiny ? tiny : c;
    value *= d * c;
    const odd = (-(a + m) * (a + b + m) * x) / ((a + 2 * m) * (a + 2 * m + 1));
    d = 1 + odd * d;
    c = 1 + odd / c;
    d = 1 / (Math.abs(d) < tiny ? tiny : d);
    c = Math.abs(c) < tiny ? tiny : c;
    value *= d * c;
    if (Math.abs(d * c - 1) < 1e-15) break;
  }
  return value;
}

/** The mass of Beta(a, b) below x, as a function of x. */
export function betaBelow(a: number, b: number): (x: number) => number {
  const norm = logGamma(a + b) - logGamma(a) - logGamma(b);
  return (x) => {
    if (x <= 0) return 0;
    if (x >= 1) return 1;
    const front = Math.exp(norm + a * Math.log(x) + b * Math.log1p(-x));
    // The fraction converges fast on the side of the mean that x is on.
    return x < (a + 1) / (a + b + 2)
      ? (front * fraction(a, b, x)) / a
      : 1 - (front * fraction(b, a, 1 - x)) / b;
  };
}

/** Where a mass of Beta(a, b) lies below: bisection in logit(x), which reaches values near 0 too. */
export function betaQuantile(a: number, b: number, mass: number, steps = 60): number {
  const below = betaBelow(a, b);
  let low = -740;
  let high = 37;
  for (let i = 0; i < steps; i++) {
    const middle = (low + high) / 2;
    if (below(1 / (1 + Math.exp(-middle))) < mass) low = middle;
    else high = middle;
  }
  return 1 / (1 + Math.exp(-(low + high) / 2));
}

/** The equal-tailed interval of a level. */
export function betaInterval(a: number, b: number, level: number, steps = 60): [number, number] {
  const tail = (1 - level) / 2;
  return [betaQuantile(a, b, tail, steps), 1 - betaQuantile(b, a, tail, steps)];
}
