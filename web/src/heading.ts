// SPDX-License-Identifier: Apache-2.0
// What the map is, and the button that changes between light and dark.

import { element } from "./dom";
import type { Facts } from "./payload";
import { article, count, short } from "./words";

const DARK = matchMedia("(prefers-color-scheme: dark)");

/** Whether a viewer is shown in dark colours. */
export const isDark = (root: HTMLElement): boolean =>
  root.dataset.theme === "dark" || (root.dataset.theme !== "light" && DARK.matches);

/** The heading of a viewer in `root`; `changed` is told, until `ending`, when its colours are others. */
export function headingOf(root: HTMLElement, facts: Facts, changed: () => void, ending: AbortSignal): HTMLElement {
  const from = facts.sources.map(({ source, scans }) =>
    [source ?? "scans without a file", scans === null ? "" : `${count(scans)} scans`].filter(Boolean).join(", "));
  const shown = from.length > 3 ? [...from.slice(0, 3), `${from.length - 3} more`] : from;
  const beside = facts.given.slice(facts.counts ? 0 : 1)
    .map(({ name, what, cells }) => `beside ${name}, ${article(what)} ${what} of ${count(cells)} cells`);
  const marks = count(facts.landmarks?.length ?? 0);
  if (facts.landmarks && facts.cells > 0) beside.push(`${marks} landmarks`);
  if (facts.yaw !== 0) beside.push(`shown along its own axes, which are turned by ${short((facts.yaw * 180) / Math.PI)}\u00b0`);
  const theme = element("button", { type: "button", class: "theme" });
  const next = { auto: "light", light: "dark", dark: "auto" } as const;
  const apply = (value: keyof typeof next): void => {
    root.dataset.theme = value;
    theme.textContent = `Colours: ${value}`;
    theme.title = "auto: as the system has them";
    theme.onclick = () => apply(next[value]);
    changed();
  };
  apply(root.dataset.theme === "dark" || root.dataset.theme === "light" ? root.dataset.theme : "auto");
  DARK.addEventListener("change", changed, { signal: ending });
  return element("header", {},
    element("div", { class: "title" }, element("h1", {}, facts.name || "Map"), theme),
    element("p", {}, facts.cells === 0 ? `${marks} landmarks` : `${count(facts.cells)} known cells of ${short(facts.resolution)} m`,
      ...[...shown, ...beside].flatMap((line) => [element("br"), line])));
}
