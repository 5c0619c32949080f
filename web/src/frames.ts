// SPDX-License-Identifier: Apache-2.0
// When a canvas is drawn, and how large it is: the same for maps of 2 and of 3 dimensions.

/** Draws once per frame of the screen, however often it is asked to. */
export class Frames {
  /** Milliseconds of this program in the last frame. */
  time = 0;
  private due = false;

  constructor(private readonly draw: () => void) {}

  schedule(): void {
    if (this.due) return;
    this.due = true;
    requestAnimationFrame(() => {
      this.due = false;
      const begun = performance.now();
      this.draw();
      this.time = performance.now() - begun;
    });
  }
}

/** How many pixels of the screen a canvas covers; null: it is not shown. */
export function pixelsOf(canvas: HTMLCanvasElement): { width: number; height: number } | null {
  const width = Math.round(canvas.clientWidth * devicePixelRatio);
  const height = Math.round(canvas.clientHeight * devicePixelRatio);
  return width === 0 || height === 0 ? null : { width, height };
}
