// SPDX-License-Identifier: Apache-2.0
// What the panel has for 3D maps only: which voxels are drawn and how, the slice and the clip box.

import { airOf, MOST_DRAWN } from "./air";
import { css, type Palette, type SpacePalettes } from "./colours";
import { element } from "./dom";
import { check, choice, GAP, meaningOf, rampOf, row, type Slider, SLIDERS, swatch, type Special } from "./panel";
import type { SpaceFacts } from "./payload";
import { isOfCounts, valueOf } from "./posterior";
import { isSliced, type NumberName, type Settings, showsAir, spanOf, type Store } from "./settings";
import { count } from "./words";

export function spacePanel(facts: SpaceFacts, store: Store, palettes: () => SpacePalettes): Special {
  const choices = {
    voxels: choice("Voxels", [
      ["occupied", "Occupied"], ["free", "Occupied, free"], ["known", "Occupied, undecided, free"],
    ], (value) => store.set({ voxels: value as Settings["voxels"] })),
    paint: choice("Colours", [
      ["height", "Height"], ["probability", "Probability"], ["hits", "Hits"],
      ["reflection", "Share of beams reflected"], ["interval-width", "How uncertain that share is"],
    ], (value) => store.set({ paint: value as Settings["paint"] })),
    drag: choice("A drag turns", [["orbit", "The map (orbit)"], ["fly", "The eye (fly)"]],
      (value) => store.set({ drag: value as Settings["drag"] })),
    colours: choice("Slice shows", [["states", "Free, undecided, occupied"], ["values", "Probability"]],
      (value) => store.set({ colours: value as Settings["colours"] })),
  };
  const sliced = check("Slice at a height", (checked) => store.set({ sliced: checked }));
  const opacity = row({
    name: "opacity", label: "opacity of points", lo: 0.01, hi: 1, scale: "log", of: showsAir,
  }, store);
  const [bottom, top] = spanOf(facts, 2);
  const height = row({
    name: "sliceAt", label: "height [m]", lo: bottom, hi: top, scale: "linear", metres: true,
    of: isSliced,
  }, store);
  const clips = clipSliders(facts).map((slider) => row(slider, store));
  const clip = element("details", { class: "clip" }, element("summary", {}, "Clip box"),
    ...clips.map((one) => one.root));
  const rows = [opacity, height, ...clips];
  return {
    sliders: posteriorSliders(facts),
    roots: [choices.voxels.root, opacity.root, choices.paint.root, choices.drag.root, sliced.root, height.root,
      choices.colours.root, clip],
    update(set) {
      for (const name of ["voxels", "paint", "drag", "colours"] as const) choices[name].select.value = set[name];
      // What is free is known of counts alone: maps of probabilities come without it.
      const ofCounts = isOfCounts(set.posterior);
      choices.voxels.root.hidden = sliced.root.hidden = !ofCounts;
      for (const option of [...choices.paint.select.options].slice(2)) option.hidden = !ofCounts;
      choices.colours.root.hidden = !isSliced(set);
      sliced.box.checked = set.sliced;
      for (const one of rows) one.update(set);
    },
    doubts: (set) => doubtsOf(facts, set),
    legend: (set) => legendOf(set, palettes()),
  };
}


/** Those that decide what is occupied. */
function posteriorSliders(facts: SpaceFacts): Slider[] {
  const showsFree = (set: Settings): boolean => isSliced(set) || showsAir(set);
  return SLIDERS.map((slider): Slider => {
    switch (slider.name) {
      case "free": return { ...slider, of: showsFree };
      case "occupied": return {
        ...slider, of: () => true, between: (set) => [(showsFree(set) ? set.free : facts.free) + GAP, 1],
      };
      default: return slider;
    }
  });
}

function clipSliders(facts: SpaceFacts): Slider[] {
  return ([[0, "x"], [1, "y"], [2, "z"]] as const).flatMap(([axis, word]): Slider[] => {
    const [lo, hi] = spanOf(facts, axis);
    const [low, high] = [`${word}Low`, `${word}High`] as [NumberName, NumberName];
    const common = { lo, hi, of: () => true, scale: "linear", metres: true } as const;
    return [
      { ...common, name: low, label: `${word} from [m]`, between: (set) => [lo, set[high]] },
      { ...common, name: high, label: `${word} to [m]`, between: (set) => [set[low], hi] },
    ];
  });
}

function doubtsOf(facts: SpaceFacts, set: Settings): string[] {
  const found: string[] = [];
  if (!isOfCounts(set.posterior)) return found;
  // Passes only lower a probability: of voxels without hits, that with the fewest has the highest.
  if (facts.unhit != null && valueOf(facts, set, 0, facts.unhit) >= set.occupied) {
    found.push("So set, voxels without a hit are occupied, too: they are no boxes and are not counted.");
  }
  if (!facts.air && (isSliced(set) || showsAir(set))) {
    found.push(`The ${count(airOf(facts))} voxels without a hit are too many for the page, and there is no slice: `
      + "show a part of the map (oddsmap crop).");
  } else if (showsAir(set) && airOf(facts) > MOST_DRAWN) {
    found.push(`The ${count(airOf(facts))} voxels without a hit are too many to be drawn: a slice shows them.`);
  }
  return found;
}

function legendOf(set: Settings, { voxels, slice, free }: SpacePalettes): HTMLElement[] {
  const found: HTMLElement[] = [rampOf(voxels.ramp, spaceEnds(set))];
  if (showsAir(set)) found.push(swatch(css(free), "free points"));
  if (showsAir(set) && set.voxels === "known") found.push(swatch(css(voxels.undecided), "undecided points"));
  if (isSliced(set)) {
    found.push(...(set.colours === "states" ? [element("span", { class: "entry" }, "Slice:"), ...statesOf(slice)] : [
      rampOf(slice.ramp, ["0", `${meaningOf(set.posterior)}, in the slice`, "1"]), swatch(css(slice.unknown), "unknown"),
    ]));
  }
  return found;
}

const statesOf = ({ ramp, undecided, unknown }: Palette): HTMLElement[] => [
  swatch(css(ramp[0]!), "free"), swatch(css(undecided), "undecided"),
  swatch(css(ramp[ramp.length - 1]!), "occupied"), swatch(css(unknown), "unknown"),
];

/** What the ends of the ramp of voxels mean. */
function spaceEnds(set: Settings): string[] {
  const text = (value: number): string => String(Number(value.toPrecision(4)));
  switch (set.paint) {
    case "height": return [text(set.zLow), "height [m]", text(set.zHigh)];
    case "probability": return [text(set.occupied), "p(occupied)", "1"];
    case "hits": return ["few", "hits, logarithmic", "most"];
    default: return ["0", meaningOf(set.paint), "1"];
  }
}
