// SPDX-License-Identifier: Apache-2.0
// Colours of cells, which tell states apart also for those who see no red or no green.

import { isProbability } from "./posterior";
import type { Settings } from "./settings";

export type Colour = readonly [number, number, number];

export interface Palette {
  /** Of values from 0 to 1, evenly spaced. */
  readonly ramp: readonly Colour[];
  readonly unknown: Colour;
  readonly undecided: Colour;
}

const hex = (text: string): Colour => [
  parseInt(text.slice(1, 3), 16), parseInt(text.slice(3, 5), 16), parseInt(text.slice(5, 7), 16),
];

/** Stops of a ramp: the shader has room for as many. */
export const STOPS = 9;

// Free white and occupied near black, as in the pictures that oddsmap writes; by night reversed.
const DAY = ["#ffffff", "#e2e3e5", "#c5c7ca", "#a8abb0", "#8b8f95", "#6d7278", "#50555c", "#313740", "#11141a"];
const NIGHT = ["#0c1117", "#2b2f34", "#494d51", "#676a6e", "#85888b", "#a3a5a8", "#c1c3c5", "#dfe0e1", "#fdfdfd"];
// Matplotlib's viridis (CC0).
const VIRIDIS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];

export function paletteOf(set: Settings, night: boolean): Palette {
  const probability = isProbability(set.posterior);
  return {
    ramp: (probability ? (night ? NIGHT : DAY) : VIRIDIS).map(hex),
    unknown: hex(night ? "#263443" : "#c7d5e3"),
    undecided: hex(night ? "#d98b2b" : "#e09a3a"),
  };
}

/** What colours of a 3D map mean: of voxels, of cells of a slice, and of points of free space. */
export interface SpacePalettes {
  readonly voxels: Palette;
  readonly slice: Palette;
  readonly free: Colour;
  readonly background: Colour;
}

export const spacePalettes = (set: Settings, night: boolean): SpacePalettes => ({
  // The same by day and by night, as faces have shades of their own.
  voxels: { ramp: VIRIDIS.map(hex), unknown: hex(night ? "#0f141a" : "#e8edf2"), undecided: hex("#e09a3a") },
  slice: paletteOf(set, night),
  free: hex(night ? "#56b4e9" : "#0072b2"),
  background: hex(night ? "#0f141a" : "#e8edf2"),
});

export const css = (colour: Colour): string => `rgb(${colour.join(" ")})`;
