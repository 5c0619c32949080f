// SPDX-License-Identifier: Apache-2.0
// The page: its data stand in it, or come from the server that it came from.

import "./style.css";
import { element } from "./dom";
import { bytesOfText, readPayload } from "./payload";
import { mount, type AnyViewer } from "./viewer";

declare global {
  /** The viewer of this page, for tests and for those who look at it with developer tools. */
  var oddsmap: AnyViewer | undefined;
}

async function load(): Promise<Uint8Array<ArrayBuffer>> {
  const inPage = document.getElementById("payload");
  if (inPage) {
    const bytes = bytesOfText(inPage.textContent ?? "", Number(inPage.dataset.bytes));
    inPage.remove(); // the text is not needed any more, and takes more than the map
    return bytes;
  }
  const answer = await fetch("map.bin");
  if (!answer.ok) throw new Error(`the map could not be loaded (${answer.status}): is oddsmap view still running?`);
  return new Uint8Array(await answer.arrayBuffer());
}

const root = document.getElementById("viewer")!;
load()
  .then(readPayload)
  .then((payload) => mount(root, payload))
  .then((viewer) => {
    globalThis.oddsmap = viewer;
  })
  .catch((error: unknown) => {
    const text = error instanceof Error ? error.message : String(error);
    root.replaceChildren(element("p", { class: "failure", role: "alert" }, `The map cannot be shown: ${text}`));
  });
