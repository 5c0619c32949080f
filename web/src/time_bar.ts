// SPDX-License-Identifier: Apache-2.0
// The bar below a map with its log: which scan is shown, where it was taken, and what is drawn of it.

import { element, uniqueId } from "./dom";
import type { Beams, Journey } from "./journey";
import { count, metres, MINUS } from "./words";

export class TimeBar {
  readonly root: HTMLElement;
  private readonly slider = element("input", { type: "range", min: 0, step: 1, "aria-label": "Scan of the log" });
  private readonly where = element("output", { class: "where" });
  private readonly what = element("output", { class: "what" });
  private readonly way;
  private readonly beams;

  constructor(
    private readonly journey: Journey,
    private readonly resolution: number,
    private readonly changed: () => void,
  ) {
    this.slider.max = String(journey.facts.scans - 1);
    this.slider.value = this.slider.max;
    this.way = check("Trajectory", changed);
    this.beams = check("Beams", changed);
    this.root = element("section", { class: "time-bar", "aria-label": "The log" },
      element("div", { class: "row" }, this.where, this.way.root, this.beams.root), this.slider, this.what);
    this.slider.addEventListener("input", () => {
      this.describe();
      this.changed();
    });
    this.describe();
  }

  get scan(): number {
    return this.slider.valueAsNumber;
  }

  set scan(number: number) {
    this.slider.value = String(number);
    this.describe();
    this.changed();
  }

  get showsWay(): boolean {
    return this.way.box.checked;
  }

  get showsBeams(): boolean {
    return this.beams.box.checked;
  }

  /** Say what is drawn of the scan. */
  say(beams: Beams | string): void {
    this.what.textContent = typeof beams === "string" ? beams : inWords(beams);
  }

  private describe(): void {
    const { journey, scan, resolution } = this;
    const { facts } = journey;
    const time = journey.time(scan);
    const place = journey.at(scan);
    const axes = place && ([["x", place.x], ["y", place.y], ["z", place.z]] as const).slice(0, facts.axes);
    const words = [
      `scan ${scan} of 0 to ${facts.scans - 1}`,
      ...(time === null ? [] : [`${time.toFixed(2)} s`]),
      ...(axes ? axes.map(([name, value]) => `${name} ${metres(value, resolution)}`) : ["no pose"]),
      ...(place ? [`yaw ${degrees(place.yaw)}`] : []),
      ...(place && facts.axes === 3 ? [`pitch ${degrees(place.pitch)}`] : []),
      ...(facts.sensors.length > 1 ? [journey.sensor(scan)] : []),
    ];
    this.where.textContent = words.join(", ");
    this.slider.setAttribute("aria-valuetext", words.join(", "));
  }
}

const degrees = (angle: number): string => `${((angle * 180) / Math.PI).toFixed(1).replace("-", MINUS)}\u00b0`;

function inWords({ returned, readings, silent }: Beams): string {
  if (readings === 0) return "This sensor names cells, and has no beams.";
  let seen = 0;
  for (let i = 0; i < returned.length; i++) seen += returned[i] ? 1 : 0;
  const drawn = returned.length + silent < readings ? `${count(returned.length)} of ${count(readings)} beams, evenly chosen: `
    : `${count(returned.length)} beams: `;
  const none = silent === 0 ? "" : `; ${count(silent)} of the scan say nothing`;
  return `${drawn}${count(seen)} with a return, ${count(returned.length - seen)} without${none}`;
}

function check(label: string, changed: () => void) {
  const box = element("input", { type: "checkbox", id: uniqueId(), checked: true });
  box.addEventListener("change", changed);
  return { root: element("div", { class: "check" }, box, element("label", { for: box.id }, label)), box };
}
