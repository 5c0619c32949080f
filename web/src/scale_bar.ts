// SPDX-License-Identifier: Apache-2.0

/** The longest round length [m] that takes at most so many pixels. */
export function roundLength(metresInPixel: number, pixels: number): number {
  const most = metresInPixel * pixels;
  const power = 10 ** Math.floor(Math.log10(most));
  const step = [5, 2, 1].find((n) => n * power <= most * (1 + 1e-9)) ?? 1;
  return step * power;
}

/** A length [m] in the unit that people would use. */
export function lengthInWords(length: number): string {
  for (const [unit, size] of [["km", 1000], ["m", 1], ["cm", 0.01]] as const) {
    if (length >= size * (1 - 1e-9)) return `${Number((length / size).toPrecision(6))} ${unit}`;
  }
  return `${Number((length * 1000).toPrecision(6))} mm`;
}
