// SPDX-License-Identifier: Apache-2.0
// "Why is this cell so?": the question to the server, and its answer as a list of scans.

import { quoted } from "./command";
import { element } from "./dom";
import { inSpace, type Journey } from "./journey";
import { copyButton } from "./panel";
import { count, metres, short } from "./words";

/** One scan of an answer, see `oddsmap.viewer.questions`. */
interface Vote {
  readonly index: number;
  readonly hits: number;
  readonly passes: number;
  readonly beam_count: number;
  readonly beams: number[];
  readonly ranges: (number | null)[];
  readonly beam_hits: number[];
  readonly beam_passes: number[];
  readonly starts: number[];
  readonly ends: number[];
}

export interface Answer {
  readonly cell: number[];
  readonly centre: number[];
  readonly looked_at: number;
  readonly voted: number;
  readonly hits: number;
  readonly passes: number;
  readonly map_hits: number;
  readonly map_passes: number;
  readonly complete: boolean;
  readonly notes: string[];
  readonly scans: Vote[];
}

/** The beams of a scan that voted, with three coordinates for each start and end. */
export interface VotingBeams {
  readonly scan: number;
  readonly starts: Float64Array;
  readonly ends: Float64Array;
  readonly hit: readonly boolean[];
}

/** Beams of a scan that are written out. */
const WRITTEN = 6;

export class Why {
  readonly root: HTMLElement;
  /** The cell that was asked about: its index along each axis; null: none. */
  cell: readonly number[] | null = null;
  answer: Answer | null = null;
  voting: readonly VotingBeams[] = [];
  private readonly words = element("div", { class: "answer", role: "status" });
  private readonly list = element("ol", { class: "votes", hidden: true });
  private readonly clear = element("button", { type: "button", hidden: true }, "Clear");
  private asking: AbortController | null = null;

  constructor(
    private readonly journey: Journey,
    private readonly resolution: number,
    hint: string,
    private readonly chosen: (scan: number) => void,
    private readonly changed: () => void,
  ) {
    this.root = element("section", { class: "why", "aria-label": "Why is this cell so?" },
      element("h2", {}, "Why is this cell so?"), this.words, this.list, this.clear);
    this.words.append(hint);
    this.clear.addEventListener("click", () => {
      this.asking?.abort();
      this.show(null, [hint]);
    });
  }

  /** Ask about a cell; what was asked before is given up. */
  async ask(cell: readonly number[]): Promise<void> {
    this.asking?.abort();
    const asking = (this.asking = new AbortController());
    const centre = cell.map((index) => (index + 0.5) * this.resolution);
    if (!this.journey.facts.served) {
      this.show(cell, ["This page has no log to ask. In a terminal:", ...this.command(centre)]);
      return;
    }
    this.show(cell, [`Asking the log about the ${this.journey.facts.axes === 3 ? "voxel" : "cell"} at ${this.place(centre)} \u2026`]);
    try {
      const reply = await fetch(`why?at=${centre.map(plain).join(",")}`, { signal: asking.signal });
      const text = await reply.text();
      if (asking.signal.aborted) return;
      if (reply.ok) this.show(cell, [], JSON.parse(text) as Answer);
      else if (reply.status !== 409) this.show(cell, [`The log gives no answer: ${text.trim()}`]);
    } catch {
      if (!asking.signal.aborted) {
        this.show(cell, ["The log cannot be asked: is oddsmap view still running?"]);
      }
    }
  }

  /** Show which scan the slider is at. */
  mark(scan: number): void {
    for (const button of this.list.querySelectorAll("button")) {
      if (Number(button.dataset.scan) === scan) button.setAttribute("aria-current", "true");
      else button.removeAttribute("aria-current");
    }
  }

  private show(cell: readonly number[] | null, lines: (string | Node)[], answer: Answer | null = null): void {
    Object.assign(this, { cell, answer });
    const axes = this.journey.facts.axes;
    this.voting = (answer?.scans ?? []).map((vote) => ({
      scan: vote.index, starts: inSpace(vote.starts, axes), ends: inSpace(vote.ends, axes),
      hit: vote.beam_hits.map((hits) => hits > 0),
    }));
    const said = answer ? this.summary(answer) : lines;
    this.words.replaceChildren(...said.map((line) => typeof line === "string" ? element("p", {}, line) : line));
    this.list.replaceChildren(...(answer?.scans ?? []).map((vote) => element("li", {}, this.button(vote))));
    this.list.hidden = !answer || answer.scans.length === 0;
    this.clear.hidden = cell === null;
    this.changed();
  }

  private summary(answer: Answer): (string | Node)[] {
    const lines: (string | Node)[] = [
      `${this.journey.facts.axes === 3 ? "Voxel" : "Cell"} ${answer.cell.map((i) => short(i, 15)).join(", ")}, its middle at ${this.place(answer.centre)}.`,
      `The map has ${votes(answer.map_hits, answer.map_passes)} there.`,
      answer.voted === 0 ? `None of ${count(answer.looked_at)} scans voted on it.`
        : `${count(answer.voted)} of ${count(answer.looked_at)} scans voted: ${votes(answer.hits, answer.passes)}`
          + `${answer.complete ? "." : ", which is not what the map has."}`,
      ...answer.notes.map((note) => element("p", { class: "doubt" }, note)),
    ];
    const more = answer.voted - answer.scans.length;
    if (more > 0) lines.push(`The first ${answer.scans.length} are listed; ${count(more)} more:`, ...this.command(answer.centre));
    return lines;
  }

  private button(vote: Vote): HTMLButtonElement {
    const time = this.journey.time(vote.index);
    const sensor = this.journey.sensor(vote.index);
    const head = [
      `scan ${vote.index}`, ...(time === null ? [] : [`${time.toFixed(1)} s`]),
      ...(this.journey.facts.sensors.length > 1 ? [sensor] : []), votes(vote.hits, vote.passes),
    ];
    const beams = vote.beams.slice(0, WRITTEN).map((beam, i) => {
      const range = vote.ranges[i] === null ? "no return" : `${short(vote.ranges[i]!, 4)} m`;
      return `beam ${beam} ${vote.beam_hits[i]! > 0 ? "hit" : "passed,"} ${range}`;
    });
    const more = vote.beam_count - beams.length;
    const made = element("button", { type: "button", "data-scan": vote.index },
      element("span", { class: "vote" }, head.join(", ")),
      element("span", { class: "beams" }, beams.join("; ") + (more > 0 ? ` and ${more} more` : "")));
    made.addEventListener("click", () => this.chosen(vote.index));
    return made;
  }

  private place(centre: readonly number[]): string {
    return `${centre.map((x) => metres(x, this.resolution)).join(", ")}\u00a0m`;
  }

  /** The command that asks in a terminal, to copy. */
  private command(centre: readonly number[]): Node[] {
    const { why, options } = this.journey.facts;
    const text = [...why.map(quoted), ...centre.map(plain), ...options.map((word) => word.startsWith("--") ? word : quoted(word))].join(" ");
    const code = element("code", {
      tabindex: 0, role: "textbox", "aria-readonly": true, "aria-label": "Command that asks about the cell",
    }, text);
    return [element("div", { class: "command" }, code, copyButton(code))];
  }
}

/** A number as programs read it, without an exponent. */
const plain = (value: number): string => String(Number(value.toFixed(9)));

const votes = (hits: number, passes: number): string =>
  `${count(hits)} ${hits === 1 ? "hit" : "hits"}, ${count(passes)} ${passes === 1 ? "pass" : "passes"}`;
