// SPDX-License-Identifier: Apache-2.0
// The panel beside the map: which posterior, its numbers as sliders, the legend and the command.

import { commandOf } from "./command";
import { css, type Palette } from "./colours";
import { element, uniqueId } from "./dom";
import type { Facts } from "./payload";
import { isProbability, logit, sigmoid } from "./posterior";
import { type NumberName, type Settings, settingsOf, showsShare, type Store } from "./settings";

export interface Slider {
  readonly name: NumberName;
  readonly label: string;
  readonly lo: number;
  readonly hi: number;
  /** Where it is of any use. */
  readonly of: (set: Settings) => boolean;
  /** Sliders move evenly in this. */
  readonly scale: "linear" | "logit" | "log";
  /** What else bounds it: the other one of a pair. */
  readonly between?: (set: Settings) => [number, number];
  /** Whether it is a length, to the millimetre. */
  readonly metres?: boolean;
}

export const GAP = 0.001;
const isStates = (set: Settings): boolean => isProbability(set.posterior) && set.colours === "states";
const isClamped = (set: Settings): boolean => isProbability(set.posterior) && set.clamped;
// The calibrated posterior brings its own.
const isBeta = (set: Settings): boolean => showsShare(set) && set.posterior !== "calibrated";
const isCalibrated = (set: Settings): boolean => set.posterior === "calibrated";
const isLogOdds = (set: Settings): boolean => set.posterior === "log-odds";

export const SLIDERS: readonly Slider[] = [
  { name: "pHit", label: "p_hit, after a hit", lo: 0.5001, hi: 0.9999, of: isLogOdds, scale: "logit" },
  { name: "pMiss", label: "p_miss, after a pass", lo: 0.0001, hi: 0.4999, of: isLogOdds, scale: "logit" },
  { name: "prior", label: "prior", lo: 0.0001, hi: 0.9999, of: isLogOdds, scale: "logit" },
  { name: "fittedPrior", label: "prior", lo: 0.0001, hi: 0.9999, of: isCalibrated, scale: "logit" },
  {
    name: "free", label: "free up to", lo: 0, hi: 1, of: isStates, scale: "linear",
    between: (set) => [0, set.occupied - GAP],
  },
  {
    name: "occupied", label: "occupied from", lo: 0, hi: 1, of: isStates, scale: "linear",
    between: (set) => [set.free + GAP, 1],
  },
  {
    name: "clampLow", label: "lowest probability", lo: 0.0001, hi: 0.9999, of: isClamped, scale: "logit",
    between: (set) => [0.0001, set.clampHigh - GAP],
  },
  {
    name: "clampHigh", label: "highest probability", lo: 0.0001, hi: 0.9999, of: isClamped, scale: "logit",
    between: (set) => [set.clampLow + GAP, 0.9999],
  },
  { name: "betaA", label: "prior hits [votes]", lo: 0.01, hi: 100, of: isBeta, scale: "log" },
  { name: "betaB", label: "prior passes [votes]", lo: 0.01, hi: 100, of: isBeta, scale: "log" },
];

const identity = (x: number): number => x;
const SCALES = { linear: [identity, identity], logit: [logit, sigmoid], log: [Math.log, Math.exp] } as const;

export interface Panel {
  readonly root: HTMLElement;
  /** Show what is set. */
  update(palette: Palette): void;
}

/** What a panel has for maps of one kind only. */
export interface Special {
  readonly sliders: readonly Slider[];
  readonly roots: readonly HTMLElement[];
  update(set: Settings): void;
  doubts(set: Settings): string[];
  legend(set: Settings): HTMLElement[];
}

export function panelOf(facts: Facts, store: Store, special?: Special): Panel {
  const posterior = choice("Posterior", [
    ["log-odds", "Occupied? Log odds"],
    ...(facts.calibrated ? [["calibrated", "Occupied? Calibrated"] as const] : []),
    ...(special ? [] : [
      ["reflection", "Share of beams reflected"] as const, ["interval-width", "How uncertain that share is"] as const,
    ]),
  ], (value) => store.set({ posterior: value as Settings["posterior"] }));
  const colours = choice("Colours", [["values", "Probability"], ["states", "Free, undecided, occupied"]],
    (value) => store.set({ colours: value as Settings["colours"] }));
  const fromAfar = choice("From afar", [["walls", "Most occupied cell"], ["sums", "Evidence added up"]],
    (value) => store.set({ fromAfar: value as Settings["fromAfar"] }));
  const clamp = check("Clamp probabilities", (checked) => store.set({ clamped: checked }));
  const sliders = special?.sliders ?? SLIDERS;
  const rows = sliders.map((slider) => row(slider, store));
  const reset = element("button", { type: "button" }, "As the map has it");
  reset.addEventListener("click", () => store.set(settingsOf(facts)));
  const doubt = element("p", { class: "doubt", role: "status" });
  const legend = element("div", { class: "legend" });
  const command = element("code", {
    tabindex: 0, role: "textbox", "aria-readonly": true, "aria-label": "Command that exports what is shown",
  });
  const copy = copyButton(command);
  // The box that switches the bounds on stands above them.
  const first = sliders.findIndex((slider) => slider.name === "clampLow");
  const [beforeClamp, fromClamp] = [rows.slice(0, first), rows.slice(first)];
  const root = element("section", { class: "panel", "aria-label": "How the map is shown" },
    posterior.root, doubt, ...(special ? [] : [colours.root]), ...beforeClamp.map((one) => one.root), clamp.root,
    ...fromClamp.map((one) => one.root), ...(special?.roots ?? [fromAfar.root]), reset, legend,
    element("div", { class: "command" }, command, copy));
  return {
    root,
    update(palette) {
      const set = store.value;
      posterior.select.value = set.posterior;
      colours.select.value = set.colours;
      fromAfar.select.value = set.fromAfar;
      clamp.box.checked = set.clamped;
      colours.root.hidden = clamp.root.hidden = !isProbability(set.posterior);
      fromAfar.root.hidden = set.posterior === "interval-width";
      for (const one of rows) one.update(set);
      special?.update(set);
      doubt.textContent = [...(special?.doubts(set) ?? []), doubtOf(facts, set)].join(" ").trim();
      doubt.hidden = doubt.textContent === "";
      legend.replaceChildren(...(special?.legend(set) ?? legendOf(set, palette)));
      command.textContent = commandOf(facts, set);
    },
  };
}

/** A box to tick. */
export function check(label: string, changed: (checked: boolean) => void) {
  const box = element("input", { type: "checkbox", id: uniqueId() });
  box.addEventListener("change", () => changed(box.checked));
  return { root: element("div", { class: "check" }, box, element("label", { for: box.id }, label)), box };
}

export function choice(label: string, options: (readonly [string, string])[], chosen: (value: string) => void) {
  const select = element("select", { id: uniqueId() },
    ...options.map(([value, text]) => element("option", { value }, text)));
  select.addEventListener("change", () => chosen(select.value));
  return { root: element("div", { class: "choice" }, element("label", { for: select.id }, label), select), select };
}

export function row(slider: Slider, store: Store) {
  const [forth, back] = SCALES[slider.scale];
  const id = uniqueId();
  const range = element("input", {
    type: "range", min: forth(slider.lo), max: forth(slider.hi), step: "any", "aria-label": slider.label,
  });
  const number = element("input", { type: "number", id, min: slider.lo, max: slider.hi, step: "any" });
  const bounds = (): [number, number] => {
    const [lo, hi] = slider.between?.(store.value) ?? [slider.lo, slider.hi];
    return [Math.max(lo, slider.lo), Math.min(hi, slider.hi)];
  };
  range.addEventListener("input", () => {
    const [lo, hi] = bounds();
    const value = slider.metres ? Number(range.valueAsNumber.toFixed(3)) : rounded(back(range.valueAsNumber));
    store.set({ [slider.name]: Math.min(Math.max(value, lo), hi) });
  });
  number.addEventListener("input", () => {
    const [lo, hi] = bounds();
    const value = number.valueAsNumber;
    const fits = value >= lo && value <= hi;
    number.setAttribute("aria-invalid", String(!fits));
    if (fits) store.set({ [slider.name]: value });
  });
  number.addEventListener("blur", () => {
    number.setAttribute("aria-invalid", "false");
    number.value = String(store.value[slider.name]);
  });
  return {
    root: element("div", { class: "slider" }, element("label", { for: id }, slider.label), number, range),
    update(this: { root: HTMLElement }, set: Settings): void {
      this.root.hidden = !slider.of(set);
      const value = set[slider.name];
      // What is being typed stays as it is.
      if (document.activeElement !== number) number.value = String(Number(value.toPrecision(12)));
      range.value = String(forth(value));
      range.setAttribute("aria-valuetext", String(Number(value.toPrecision(4))));
    },
  };
}

/** Four decimals, or three digits of a number above. */
const rounded = (value: number): number => Number(value < 1 ? value.toFixed(4) : value.toPrecision(3));

function doubtOf(facts: Facts, set: Settings): string {
  if (facts.rounded) return "Weights of this map are too large for the page and were rounded to 32 bits.";
  if (!showsShare(set)) return "";
  if (facts.sensor === "cone") {
    return "Counting does badly under wide beams, whose hits belong to one cell of many.";
  }
  if (facts.votes === "scan" && facts.sensor === "beam") {
    return "Too high: within a scan hits win over passes. A map built with --votes beam counts every beam.";
  }
  return "";
}

export function swatch(colour: string, text: string): HTMLElement {
  const box = element("span", { class: "swatch" });
  box.style.backgroundColor = colour;
  return element("span", { class: "entry" }, box, text);
}

function legendOf(set: Settings, palette: Palette): HTMLElement[] {
  const unknown = swatch(css(palette.unknown), "unknown");
  const { ramp } = palette;
  if (isStates(set)) {
    return [
      swatch(css(ramp[0]!), "free"), swatch(css(palette.undecided), "undecided"),
      swatch(css(ramp[ramp.length - 1]!), "occupied"), unknown,
    ];
  }
  return [rampOf(ramp, ["0", MEANINGS[set.posterior], "1"]), unknown];
}

/** What colours are of. */
export const MEANINGS = {
  "log-odds": "p(occupied)", calibrated: "p(occupied)", reflection: "mean reflectivity",
  "interval-width": "width of the 95 % interval",
} as const;

export function rampOf(ramp: Palette["ramp"], ends: string[]): HTMLElement {
  const bar = element("div", { class: "ramp" });
  bar.style.backgroundImage = `linear-gradient(to right, ${ramp.map(css).join(", ")})`;
  return element("div", { class: "ramp-and-ends" }, bar,
    element("div", { class: "ends" }, ...ends.map((text) => element("span", {}, text))));
}

/** The button that copies a command. */
export function copyButton(command: HTMLElement): HTMLButtonElement {
  const copy = element("button", { type: "button" }, "Copy command");
  copy.addEventListener("click", () => void copied(command).then((done) => {
    copy.textContent = done ? "Copied" : "Select and copy it";
    setTimeout(() => (copy.textContent = "Copy command"), 2000);
  }));
  return copy;
}

/** Copy the text of an element; where the browser does not allow it, it is selected. */
async function copied(source: HTMLElement): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(source.textContent ?? "");
    return true;
  } catch {
    getSelection()?.selectAllChildren(source);
    return false;
  }
}
