// SPDX-License-Identifier: Apache-2.0
// Mouse, wheel, fingers and keys move the camera.

import type { Camera } from "./camera";

export interface Moves {
  /** The camera has moved. */
  moved(): void;
  /** A pointer is over a pixel of the screen; null: it has left. */
  pointed(at: readonly [number, number] | null): void;
  /** Somebody works with the keys: what is described is in the middle. */
  keyed(): void;
  /** Somebody asks about a pixel: by a click, or by Enter about the one in the middle. */
  asked(at: readonly [number, number]): void;
}

const KEY_ZOOM = 1.5;
/** Share of the screen that an arrow key moves by. */
const KEY_PAN = 0.1;
const NOTCH = 120;
/** A pointer that moves farther while it is down drags [pixels of the page]. */
const DRAG = 4;

/** Listen on a canvas; gives what ends that. */
export function listen(canvas: HTMLCanvasElement, camera: Camera, moves: Moves): AbortController {
  const ending = new AbortController();
  const { signal } = ending;
  const pointers = new Map<number, [number, number]>();
  let down = { x: 0, y: 0 };
  /** Where a pointer was lifted: a click itself comes in whole pixels, and may be of the cell beside. */
  let up: [number, number] = [0, 0];
  const place = (event: MouseEvent): [number, number] => {
    const box = canvas.getBoundingClientRect();
    const pixels = camera.width / box.width;
    return [(event.clientX - box.left) * pixels, (event.clientY - box.top) * pixels];
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    down = { x: event.clientX, y: event.clientY };
    pointers.set(event.pointerId, place(event));
    canvas.classList.add("held");
    moves.pointed(place(event));
  }, { signal });
  canvas.addEventListener("pointermove", (event) => {
    const now = place(event);
    const before = pointers.get(event.pointerId);
    if (before) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
      if (other) {
        // Two fingers: what lies under each of them stays there.
        const times = distance(now, other) / Math.max(distance(before, other), 1);
        camera.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
        camera.zoom(times, (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      } else {
        camera.pan(now[0] - before[0], now[1] - before[1]);
      }
      pointers.set(event.pointerId, now);
      moves.moved();
    }
    moves.pointed(now);
  }, { signal });
  for (const name of ["pointerup", "pointercancel"] as const) {
    canvas.addEventListener(name, (event) => {
      pointers.delete(event.pointerId);
      up = place(event);
      if (pointers.size === 0) canvas.classList.remove("held");
    }, { signal });
  }
  canvas.addEventListener("pointerleave", (event) => {
    // A finger that is lifted leaves, too: what it tapped stays described.
    if (event.pointerType !== "touch") moves.pointed(null);
  }, { signal });
  canvas.addEventListener("click", (event) => {
    // The second click of two zooms.
    if (event.detail > 1 || Math.hypot(event.clientX - down.x, event.clientY - down.y) > DRAG) return;
    moves.asked(up);
  }, { signal });
  canvas.addEventListener("dblclick", (event) => {
    camera.zoom(2, ...place(event));
    moves.moved();
  }, { signal });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    // Lines and pages, which some mice count in, as pixels.
    const size = event.deltaMode === 0 ? 1 : event.deltaMode === 1 ? 40 : 800;
    camera.zoom(2 ** ((-event.deltaY * size) / (2 * NOTCH)), ...place(event));
    moves.moved();
    moves.pointed(place(event));
  }, { signal, passive: false });
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !act(event.key, event.shiftKey)) return;
    event.preventDefault();
    moves.moved();
    moves.keyed();
  }, { signal });
  canvas.addEventListener("focus", () => {
    if (canvas.matches(":focus-visible")) moves.keyed();
  }, { signal });

  /** Do what a key stands for; false: nothing. */
  function act(key: string, byCell: boolean): boolean {
    const step = byCell ? 1 / camera.scale : KEY_PAN * Math.min(camera.width, camera.height);
    switch (key) {
      case "ArrowLeft": camera.pan(step, 0); return true;
      case "ArrowRight": camera.pan(-step, 0); return true;
      case "ArrowUp": camera.pan(0, step); return true;
      case "ArrowDown": camera.pan(0, -step); return true;
      case "+": case "=": camera.zoom(KEY_ZOOM); return true;
      case "-": case "_": camera.zoom(1 / KEY_ZOOM); return true;
      case "0": case "Home": camera.fit(); return true;
      case "Enter": moves.asked([camera.width / 2, camera.height / 2]); return true;
      default: return false;
    }
  }
  return ending;
}

const distance = (a: readonly [number, number], b: readonly [number, number]): number =>
  Math.hypot(a[0] - b[0], a[1] - b[1]);
