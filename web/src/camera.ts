// SPDX-License-Identifier: Apache-2.0
// Which part of the plane is on the screen. Positions are in cells, from the origin of the map.

export interface Box {
  readonly lo: readonly [number, number];
  readonly hi: readonly [number, number];
}

/** A cell fills at most this many pixels. */
const LARGEST_CELL = 160;
const MARGIN = 1.06;

export class Camera {
  x = 0;
  y = 0;
  /** Cells in a pixel of the screen. */
  scale = 1;
  width = 1;
  height = 1;
  private fitted = false;

  constructor(private readonly box: Box) {}

  /** The screen has another size [pixels]; the middle stays where it is. */
  resize(width: number, height: number): void {
    this.width = Math.max(width, 1);
    this.height = Math.max(height, 1);
    this.limit();
  }

  /** Whether the whole map is shown, and nobody has moved it since. */
  isFitted(): boolean {
    return this.fitted;
  }

  /** Show the whole map. */
  fit(): void {
    this.fitted = true;
    const { lo, hi } = this.box;
    this.x = (lo[0] + hi[0]) / 2;
    this.y = (lo[1] + hi[1]) / 2;
    this.scale = this.fitting();
  }

  /** Move by pixels, to the right and down as pointers do. */
  pan(right: number, down: number): void {
    this.fitted = false;
    this.x -= right * this.scale;
    this.y += down * this.scale;
    this.limit();
  }

  /** Show everything that many times as large, with what lies at a pixel staying there. */
  zoom(times: number, right = this.width / 2, down = this.height / 2): void {
    this.fitted = false;
    const [x, y] = this.at(right, down);
    this.scale = Math.min(Math.max(this.scale / times, 1 / LARGEST_CELL), 4 * this.fitting());
    const [movedX, movedY] = this.at(right, down);
    this.x += x - movedX;
    this.y += y - movedY;
    this.limit();
  }

  /** What lies at a pixel, counted from the left and from above. */
  at(right: number, down: number): [number, number] {
    return [
      this.x + (right - this.width / 2) * this.scale,
      this.y - (down - this.height / 2) * this.scale,
    ];
  }

  private fitting(): number {
    const { lo, hi } = this.box;
    const across = (hi[0] - lo[0]) / this.width;
    const up = (hi[1] - lo[1]) / this.height;
    return Math.max(MARGIN * Math.max(across, up), 1 / LARGEST_CELL);
  }

  /** The middle stays above the map, so that nobody gets lost. */
  private limit(): void {
    const { lo, hi } = this.box;
    this.x = Math.min(Math.max(this.x, lo[0]), hi[0]);
    this.y = Math.min(Math.max(this.y, lo[1]), hi[1]);
  }
}
