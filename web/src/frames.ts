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

/** Hear of other sizes of a canvas until a viewer is closed; then its memory on the graphics card is free. */
export function untilClosed(
  canvas: HTMLCanvasElement, gl: WebGL2RenderingContext, ending: AbortSignal, resized: () => void,
): void {
  const observer = new ResizeObserver(resized);
  observer.observe(canvas);
  ending.addEventListener("abort", () => {
    observer.disconnect();
    // A page has a handful of contexts: left to the garbage collector, they would run out.
    gl.getExtension("WEBGL_lose_context")?.loseContext();
  });
}
