// SPDX-License-Identifier: Apache-2.0
// Elements made in one expression. Text is always text: nothing from a file becomes markup.

type Attributes = Record<string, string | number | boolean>;

export function element<K extends keyof HTMLElementTagNameMap>(
  name: K,
  attributes: Attributes = {},
  ...children: (Node | string)[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== false) made.setAttribute(key, value === true ? "" : String(value));
  }
  made.append(...children);
  return made;
}

let made = 0;

/** A name that no other element has. */
export const uniqueId = (): string => `oddsmap-${++made}`;
