// SPDX-License-Identifier: Apache-2.0
// The viewer in a cell of a notebook: a module as anywidget loads it. It lives in a shadow tree, so
// that neither the style of the notebook nor that of another map on the page reaches it.

import css from "./style.css?inline";
import { element } from "./dom";
import { readPayload } from "./payload";
import type { Settings, Store } from "./settings";
import { mount } from "./viewer";

/** What anywidget gives of the state that Python shares with the page. */
interface Model {
  get(name: string): unknown;
  set(name: string, value: unknown): void;
  save_changes(): void;
  on(event: string, listener: () => void): void;
  off(event: string, listener: () => void): void;
}

/** Settings that Python knows too, by the names that it has for them. */
const SHARED = {
  posterior: "posterior", p_hit: "pHit", p_miss: "pMiss", prior: "prior", free: "free", occupied: "occupied",
} as const;
/** Python hears of a slider that moves at most so often [ms]. */
const TOLD_EVERY = 100;

/** Whether the page around is dark, where it says so: JupyterLab, VS Code, Colab. */
function themeAround(): "light" | "dark" | "auto" {
  const { body, documentElement } = document;
  const said = body.dataset["jpThemeLight"] ?? body.dataset["vscodeThemeKind"] ?? documentElement.getAttribute("theme");
  if (!said) return "auto";
  return said === "false" || /dark|contrast$/.test(said) ? "dark" : "light";
}

/** Keep settings the same here and in Python; gives what ends that. */
function share(model: Model, store: Store): () => void {
  const names = Object.entries(SHARED);
  let telling = false; // the model has some of what the store has, and not yet all of it
  const take = (): void => {
    if (telling) return;
    const change = Object.fromEntries(names.map(([theirs, ours]) => [ours, model.get(theirs)])) as Partial<Settings>;
    if (names.some(([, ours]) => store.value[ours] !== change[ours])) store.set(change);
  };
  let due: ReturnType<typeof setTimeout> | undefined;
  const tell = (): void => {
    const others = names.filter(([theirs, ours]) => model.get(theirs) !== store.value[ours]);
    telling = true;
    for (const [theirs, ours] of others) model.set(theirs, store.value[ours]);
    telling = false;
    if (others.length === 0) return;
    due ??= setTimeout(() => {
      due = undefined;
      model.save_changes();
    }, TOLD_EVERY);
  };
  take();
  store.listen(tell);
  for (const [theirs] of names) model.on(`change:${theirs}`, take);
  return () => {
    for (const [theirs] of names) model.off(`change:${theirs}`, take);
  };
}

/** Show the map of a model in an element; gives what takes it away. */
async function render({ model, el }: { model: Model; el: HTMLElement }): Promise<() => void> {
  // Without the attribute JupyterLab takes keys for its own, as "0", which restarts the kernel.
  const host = element("div", { "data-lm-suppress-shortcuts": true });
  const root = element("div", { class: "oddsmap", "data-theme": themeAround() });
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(css);
  const tree = host.attachShadow({ mode: "open" });
  tree.adoptedStyleSheets = [sheet];
  tree.append(root);
  el.append(host);
  const resize = (): void => void (host.style.height = `${Number(model.get("height"))}px`);
  resize();
  model.on("change:height", resize);
  host.addEventListener("keydown", (event) => event.stopPropagation());
  // The wheel goes on scrolling the page, until somebody has clicked the map.
  root.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !tree.activeElement?.contains(event.target as Node)) event.stopPropagation();
  }, { capture: true });
  const endings = [() => model.off("change:height", resize), () => host.remove()];
  try {
    const payload = await readPayload(payloadOf(model));
    payload.facts.name = "";
    const viewer = await mount(root, payload);
    if (model.get("linked")) endings.push(share(model, viewer.store));
    endings.push(() => viewer.close());
    Object.assign(host, { oddsmap: viewer }); // for tests and for developer tools
  } catch (error) {
    const text = error instanceof Error ? error.message : String(error);
    root.replaceChildren(element("p", { class: "failure", role: "alert" }, `The map cannot be shown: ${text}`));
  }
  return () => {
    for (const end of endings) end();
  };
}

function payloadOf(model: Model): Uint8Array<ArrayBuffer> {
  const data = model.get("payload") as DataView<ArrayBuffer> | undefined;
  if (!data?.byteLength) throw new Error("Python does not hold it any more. Run the cell again.");
  return new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
}

export default { render };
