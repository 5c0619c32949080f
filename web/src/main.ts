// SPDX-License-Identifier: Apache-2.0
// The page: its data stand in it, or come from the server that it came from.

import "./style.css";
import { element } from "./dom";
import { type Journey, journeyOf, type JourneyPayload } from "./journey";
import { bytesOfText, readPayload } from "./payload";
import { mount, type AnyViewer } from "./viewer";

declare global {
  /** The viewer of this page, for tests and for those who look at it with developer tools. */
  var oddsmap: AnyViewer | undefined;
}

/** Data that stand in the page in an element of this name, or beside it in a file; null: nowhere. */
async function load(id: string, file: string | undefined): Promise<Uint8Array<ArrayBuffer> | null> {
  const inPage = document.getElementById(id);
  if (inPage) {
    const bytes = bytesOfText(inPage.textContent ?? "", Number(inPage.dataset.bytes));
    inPage.remove(); // the text is not needed any more, and takes more than the map
    return bytes;
  }
  if (file === undefined) return null;
  const answer = await fetch(file);
  if (!answer.ok) throw new Error(`the map could not be loaded (${answer.status}): is oddsmap view still running?`);
  return new Uint8Array(await answer.arrayBuffer());
}

async function loadLog(): Promise<Journey | null> {
  const bytes = await load("log", root.dataset.log);
  return bytes && journeyOf((await readPayload(bytes)) as unknown as JourneyPayload);
}

const root = document.getElementById("viewer")!;
Promise.all([load("payload", "map.bin").then((bytes) => readPayload(bytes!)), loadLog()])
  .then(([payload, journey]) => mount(root, payload, journey))
  .then((viewer) => {
    globalThis.oddsmap = viewer;
  })
  .catch((error: unknown) => {
    const text = error instanceof Error ? error.message : String(error);
    root.replaceChildren(element("p", { class: "failure", role: "alert" }, `The map cannot be shown: ${text}`));
  });
