// SPDX-License-Identifier: Apache-2.0
// From where a 3D map is seen. Positions are in voxels, from the first cell of the map.

export type Vector = [number, number, number];

/** How far an eye sees up and down of the middle [rad]. */
const HALF_VIEW = 0.4;
const STEEPEST = Math.PI / 2 - 1e-3;
const NEAREST = 2;

export class SpaceCamera {
  /** What is in the middle of the screen, and how far away it is. */
  target: Vector = [0, 0, 0];
  distance = 1;
  /** Directions of the view [rad]: yaw from the x axis, pitch downwards. */
  yaw = 0;
  pitch = 0;
  width = 1;
  height = 1;
  private fitted = false;

  /** @param box of what there is to see. */
  constructor(private readonly box: { readonly lo: readonly number[]; readonly hi: readonly number[] }) {}

  private get size(): number[] {
    return this.box.hi.map((end, axis) => end - this.box.lo[axis]!);
  }

  isFitted(): boolean {
    return this.fitted;
  }

  /** Pixels in a tangent of 1. */
  get focal(): number {
    return this.height / 2 / Math.tan(HALF_VIEW);
  }

  /** Show all of it, from above and aside. */
  fit(yaw = 0.9, pitch = 0.7): void {
    this.fitted = true;
    Object.assign(this, { yaw, pitch, target: this.box.lo.map((from, axis) => (from + this.box.hi[axis]!) / 2) });
    // The corner that asks for the greatest distance decides.
    const [right, up, back] = this.axes();
    this.distance = NEAREST;
    for (let corner = 0; corner < 8; corner++) {
      const from = this.size.map((n, axis) => ((corner >> axis) & 1 ? n / 2 : -n / 2)) as Vector;
      const aside = Math.abs(dot(right, from)) / (this.width / 2);
      const above = Math.abs(dot(up, from)) / (this.height / 2);
      this.distance = Math.max(this.distance, 1.04 * (dot(back, from) + this.focal * Math.max(aside, above)));
    }
  }

  /** To the right, upwards, and back from what is seen: the axes of the view in the map. */
  axes(): [Vector, Vector, Vector] {
    const [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const [cp, sp] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    return [[s, -c, 0], [c * sp, s * sp, cp], [-c * cp, -s * cp, sp]];
  }

  eye(): Vector {
    const back = this.axes()[2];
    return this.target.map((x, axis) => x + back[axis]! * this.distance) as Vector;
  }

  /** The direction in which a pixel lies, counted from the top left: 1 along the depth. */
  rayAt(x: number, y: number): Vector {
    const [right, up, back] = this.axes();
    const aside = (x - this.width / 2) / this.focal;
    const above = (this.height / 2 - y) / this.focal;
    return back.map((b, axis) => aside * right[axis]! + above * up[axis]! - b) as Vector;
  }

  /** Where a place is seen: pixels from the top left, and how deep it lies. */
  seen(place: readonly number[]): Vector {
    const eye = this.eye();
    const from = place.map((x, axis) => x - eye[axis]!);
    const [aside, above, behind] = this.axes().map((axis) => dot(axis, from)) as Vector;
    const scale = -this.focal / behind;
    return [this.width / 2 + aside * scale, this.height / 2 - above * scale, -behind];
  }

  /** Turn by pixels as pointers move: around the middle, or around the eye. */
  turn(right: number, down: number, aroundEye = false): void {
    this.fitted = false;
    const eye = this.eye();
    const angle = (aroundEye ? 2 * HALF_VIEW : Math.PI) / this.height;
    const way = aroundEye ? 1 : -1;
    this.yaw += way * right * angle;
    this.pitch = Math.min(Math.max(this.pitch - way * down * angle, -STEEPEST), STEEPEST);
    if (!aroundEye) return;
    const back = this.axes()[2];
    this.target = eye.map((x, axis) => x - back[axis]! * this.distance) as Vector;
  }

  /** Move along by pixels: what is in the middle goes with the pointer. */
  pan(right: number, down: number): void {
    const scale = this.distance / this.focal;
    this.move(-right * scale, down * scale, 0);
  }

  /** Move by voxels: to the right, upwards, ahead. */
  move(right: number, up: number, ahead: number): void {
    this.fitted = false;
    const axes = this.axes();
    const far = 2 * Math.max(...this.size);
    this.target = this.target.map((x, axis) => {
      const moved = x + right * axes[0][axis]! + up * axes[1][axis]! - ahead * axes[2][axis]!;
      return Math.min(Math.max(moved, this.box.lo[axis]! - far), this.box.hi[axis]! + far);
    }) as Vector;
  }

  zoom(times: number): void {
    this.fitted = false;
    this.distance = Math.min(Math.max(this.distance / times, NEAREST), 8 * Math.hypot(...this.size));
  }
}

const dot = (a: readonly number[], b: readonly number[]): number =>
  a[0]! * b[0]! + a[1]! * b[1]! + a[2]! * b[2]!;
