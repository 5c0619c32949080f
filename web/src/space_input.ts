// SPDX-License-Identifier: Apache-2.0
// Mouse, wheel, fingers and keys turn and move a 3D map.

import type { SpaceCamera } from "./space_camera";

const KEY_ZOOM = 1.25;
const KEY_TURN = 40;
const NOTCH = 120;
/** Share of the distance that a key moves by. */
const KEY_MOVE = 0.08;
/** A pointer that moved less far between down and up has clicked [pixels of the page]. */
const STILL = 4;

export interface SpaceMoves {
  /** Whether a drag turns around the eye. */
  aroundEye(): boolean;
  /** The camera has moved. */
  moved(): void;
  /** A pointer is over a pixel of the screen; null: it has left. */
  pointed(at: readonly [number, number] | null): void;
  /** Somebody works with the keys: what is described is in the middle. */
  keyed(): void;
  /** A pixel was clicked or tapped; null: the key for it, of the middle. */
  clicked(at: readonly [number, number] | null): void;
}

export function listenInSpace(canvas: HTMLCanvasElement, camera: SpaceCamera, moves: SpaceMoves): void {
  const { aroundEye } = moves;
  const pointers = new Map<number, [number, number]>();
  /** Where the only pointer went down, as long as it may be a click. */
  let begun: [number, number] | null = null;
  const pixels = (): number => camera.width / Math.max(canvas.clientWidth, 1);
  const place = (event: MouseEvent): [number, number] => {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * pixels(), (event.clientY - box.top) * pixels()];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    begun = pointers.size === 1 && event.button === 0 ? place(event) : null;
    canvas.classList.add("held");
    moves.pointed(place(event));
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    const now = place(event);
    if (!before) {
      moves.pointed(now);
      return;
    }
    if (begun && Math.hypot(now[0] - begun[0], now[1] - begun[1]) > STILL * pixels()) begun = null;
    const [right, down] = [now[0] - before[0], now[1] - before[1]];
    const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      // Two fingers move, and their distance zooms.
      const apart = (at: readonly [number, number]): number => Math.hypot(at[0] - other[0], at[1] - other[1]);
      camera.pan(right / 2, down / 2);
      camera.zoom(apart(now) / Math.max(apart(before), 1));
    } else if (event.shiftKey || event.buttons & 6) {
      camera.pan(right, down);
    } else {
      camera.turn(right, down, aroundEye());
    }
    pointers.set(event.pointerId, now);
    moves.moved();
    moves.pointed(now);
  });
  for (const name of ["pointerup", "pointercancel"] as const) {
    canvas.addEventListener(name, (event) => {
      pointers.delete(event.pointerId);
      if (pointers.size === 0) canvas.classList.remove("held");
      if (begun && name === "pointerup") moves.clicked(place(event));
      begun = null;
    });
  }
  canvas.addEventListener("pointerleave", (event) => {
    // A finger that is lifted leaves, too: what it tapped stays described.
    if (event.pointerType !== "touch") moves.pointed(null);
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    // Lines and pages, which some mice count in, as pixels.
    const size = event.deltaMode === 0 ? 1 : event.deltaMode === 1 ? 40 : 800;
    camera.zoom(2 ** ((-event.deltaY * size) / (4 * NOTCH)));
    moves.moved();
    moves.pointed(place(event));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !act(event.key)) return;
    event.preventDefault();
    moves.moved();
    moves.keyed();
  });
  canvas.addEventListener("focus", () => {
    if (canvas.matches(":focus-visible")) moves.keyed();
  });

  /** Do what a key stands for; false: nothing. */
  function act(key: string): boolean {
    const step = KEY_MOVE * camera.distance;
    switch (key.toLowerCase()) {
      case "arrowleft": camera.turn(KEY_TURN, 0, aroundEye()); return true;
      case "arrowright": camera.turn(-KEY_TURN, 0, aroundEye()); return true;
      case "arrowup": camera.turn(0, KEY_TURN, aroundEye()); return true;
      case "arrowdown": camera.turn(0, -KEY_TURN, aroundEye()); return true;
      case "w": camera.move(0, 0, step); return true;
      case "s": camera.move(0, 0, -step); return true;
      case "a": camera.move(-step, 0, 0); return true;
      case "d": camera.move(step, 0, 0); return true;
      case "e": camera.move(0, step, 0); return true;
      case "q": camera.move(0, -step, 0); return true;
      case "+": case "=": camera.zoom(KEY_ZOOM); return true;
      case "-": case "_": camera.zoom(1 / KEY_ZOOM); return true;
      case "0": case "home": camera.fit(); return true;
      case "1": camera.fit(Math.PI / 2, Math.PI / 2 - 1e-3); return true;
      case "enter": moves.clicked(null); return true;
      default: return false;
    }
  }
}
