// SPDX-License-Identifier: Apache-2.0
// The posterior of a cell and its colour, as every layer's shaders work them out from hits and passes.
// Whatever a slider changes is a uniform.

import { betaInterval } from "./beta";
import { type Palette, STOPS } from "./colours";
import { floats, type Program } from "./gl";
import { givenOf } from "./given";
import type { CountModel, Facts } from "./payload";
import { LEVEL, logit } from "./posterior";
import type { Settings } from "./settings";

/** Side of the table of interval widths, and the logarithms of the weights at its first and last. */
export const WIDTHS = { side: 128, first: Math.log(1e-2), last: Math.log(1e6) } as const;

/** Values of a distribution of reflectivities, and how many distributions a model has. */
export const MODEL = { values: 48, knots: 8 } as const;

export const POSTERIORS = { "log-odds": 0, calibrated: 1, reflection: 2, "interval-width": 3, given: 4 } as const;

/** Side of the table of probabilities that came with the page. */
const VALUES = 256;

const NO_CLAMP = 1e30;

/** To stand in a shader: `value_of(votes)`, `score_of(votes)` and `colour_of(value)`. */
export const POSTERIOR = `
uniform sampler2D u_widths;
uniform sampler2D u_model;
uniform sampler2D u_values;
uniform int u_posterior;
uniform bool u_states;
uniform float u_prior;       // log odds
uniform vec2 u_rates;        // log odds that a hit adds, and a pass
uniform vec2 u_clamp;        // lowest and highest log odds
uniform vec2 u_beta;         // weights of the Beta prior
uniform vec2 u_thresholds;   // free, occupied
uniform vec3 u_ramp[${STOPS}];
uniform vec3 u_undecided;
uniform float u_share;       // log odds of the share of occupied cells that the model knows

float sigmoid(float x) {
  float small = exp(-abs(x));
  return (x >= 0.0 ? 1.0 : small) / (1.0 + small);
}

// As CountModel in Python: rows of u_model are distributions, then log r, log (1 - r) and p(occupied | r).
float bayes_factor(vec2 v) {
  float place = min(log2(1.0 + v.x + v.y), ${MODEL.knots - 1}.0);
  int below = min(int(place), ${MODEL.knots - 2});
  float share = place - float(below);
  float best = -1e38;
  for (int j = 0; j < ${MODEL.values}; j++) {
    float log_r = texelFetch(u_model, ivec2(j, ${MODEL.knots}), 0).r;
    float log_q = texelFetch(u_model, ivec2(j, ${MODEL.knots + 1}), 0).r;
    best = max(best, v.x * log_r + v.y * log_q);
  }
  float yes = 0.0;
  float no = 0.0;
  for (int j = 0; j < ${MODEL.values}; j++) {
    float log_r = texelFetch(u_model, ivec2(j, ${MODEL.knots}), 0).r;
    float log_q = texelFetch(u_model, ivec2(j, ${MODEL.knots + 1}), 0).r;
    float occupied = texelFetch(u_model, ivec2(j, ${MODEL.knots + 2}), 0).r;
    float prior = mix(texelFetch(u_model, ivec2(j, below), 0).r,
                      texelFetch(u_model, ivec2(j, below + 1), 0).r, share);
    float joint = prior * exp(v.x * log_r + v.y * log_q - best);
    yes += occupied * joint;
    no += (1.0 - occupied) * joint;
  }
  return log(max(yes, 1e-37)) - log(max(no, 1e-37)) - u_share;
}

// The table holds logarithms, between which there is hardly a bend.
float interval_width(vec2 weights) {
  vec2 place = (log(weights) - ${WIDTHS.first}) * ${((WIDTHS.side - 1) / (WIDTHS.last - WIDTHS.first)).toFixed(9)};
  place = clamp(place, vec2(0.0), vec2(${WIDTHS.side - 1}.0));
  ivec2 low = min(ivec2(place), ivec2(${WIDTHS.side - 2}));
  vec2 share = place - vec2(low);
  float a = mix(texelFetch(u_widths, low, 0).r, texelFetch(u_widths, low + ivec2(1, 0), 0).r, share.x);
  float b = mix(texelFetch(u_widths, low + ivec2(0, 1), 0).r, texelFetch(u_widths, low + ivec2(1, 1), 0).r, share.x);
  return exp(mix(a, b, share.y));
}

float share_of(vec2 v) {
  return (u_beta.x + v.x) / (u_beta.x + u_beta.y + v.x + v.y);
}

float value_of(vec2 v) {
  if (u_posterior == ${POSTERIORS.given}) {
    int number = int(v.x);
    return texelFetch(u_values, ivec2(number % ${VALUES}, number / ${VALUES}), 0).r;
  }
  if (u_posterior == ${POSTERIORS.reflection}) return share_of(v);
  if (u_posterior == ${POSTERIORS["interval-width"]}) return interval_width(u_beta + v);
  float evidence = u_posterior == ${POSTERIORS.calibrated} ? bayes_factor(v) : dot(u_rates, v);
  return sigmoid(clamp(u_prior + evidence, u_clamp.x, u_clamp.y));
}

// What tells the most occupied of some cells: of log odds and of reflectivities it does exactly, and
// the calibrated posterior is theirs by reflectivity, too.
float score_of(vec2 v) {
  if (u_posterior == ${POSTERIORS.given}) return v.x;
  return u_posterior == ${POSTERIORS["log-odds"]} ? dot(u_rates, v) : share_of(v);
}

// Of many cells together: what is added up of each, and the value of their mean.
vec2 part_of(vec2 v) {
  return u_posterior == ${POSTERIORS.given} ? vec2(value_of(v), 0.0) : v;
}

float mean_of(vec2 sum, float cells) {
  return u_posterior == ${POSTERIORS.given} ? sum.x / cells : value_of(sum / cells);
}

vec3 ramp(float value) {
  float place = clamp(value, 0.0, 1.0) * ${STOPS - 1}.0;
  int below = min(int(place), ${STOPS - 2});
  return mix(u_ramp[below], u_ramp[below + 1], place - float(below));
}

// From 0 to 255.
vec3 colour_of(float value) {
  if (!u_states) return ramp(value);
  if (value >= u_thresholds.y) return u_ramp[${STOPS - 1}];
  return value <= u_thresholds.x ? u_ramp[0] : u_undecided;
}
`;

/** The tables that shaders look values up in. */
export class PosteriorTables {
  private readonly empty: WebGLTexture;
  private readonly fitted: WebGLTexture;
  private readonly model: CountModel | null;
  private readonly values = new Map<Float64Array, WebGLTexture>();
  private widths: WebGLTexture | null = null;

  /** @param uploaded told how many bytes went to the graphics card. */
  constructor(
    private readonly gl: WebGL2RenderingContext,
    private readonly facts: Facts,
    private readonly uploaded: (bytes: number) => void,
  ) {
    const model = (this.model = facts.calibrated);
    this.empty = this.table(1, 1, new Float32Array(1));
    this.fitted = model ? this.table(MODEL.values, MODEL.knots + 3, numbersOf(model)) : this.empty;
  }

  /** Set all uniforms of `POSTERIOR` in the program in use; takes three units from the given one on. */
  use(program: Program, unit: number, set: Settings, palette: Palette): void {
    const { gl, model } = this;
    // A texture is bound while it is made: to a unit that is ours.
    gl.activeTexture(gl.TEXTURE0 + unit);
    const shows = [set.posterior, set.paint];
    if (shows.includes("interval-width")) this.widths ??= this.table(WIDTHS.side, WIDTHS.side, widths());
    const given = givenOf(this.facts, set.posterior);
    const tables = {
      u_widths: this.widths ?? this.empty, u_model: this.fitted,
      u_values: given ? this.valuesOf(given.values) : this.empty,
    };
    Object.entries(tables).forEach(([name, made], i) => {
      gl.activeTexture(gl.TEXTURE0 + unit + i);
      gl.bindTexture(gl.TEXTURE_2D, made);
      gl.uniform1i(program.at(name), unit + i);
    });
    const calibrated = set.posterior === "calibrated";
    gl.uniform1i(program.at("u_posterior"), POSTERIORS[given ? "given" : set.posterior as keyof typeof POSTERIORS]);
    gl.uniform1i(program.at("u_states"), set.colours === "states" ? 1 : 0);
    gl.uniform1f(program.at("u_prior"), logit(calibrated ? set.fittedPrior : set.prior));
    gl.uniform2f(program.at("u_rates"), logit(set.pHit), logit(set.pMiss));
    gl.uniform2f(
      program.at("u_clamp"),
      set.clamped ? logit(set.clampLow) : -NO_CLAMP,
      set.clamped ? logit(set.clampHigh) : NO_CLAMP,
    );
    const fitted = calibrated ? model?.beta : undefined;
    gl.uniform2f(program.at("u_beta"), fitted?.[0] ?? set.betaA, fitted?.[1] ?? set.betaB);
    gl.uniform2f(program.at("u_thresholds"), set.free, set.occupied);
    gl.uniform3fv(program.at("u_ramp"), palette.ramp.flat());
    gl.uniform3f(program.at("u_undecided"), ...palette.undecided);
    gl.uniform1f(program.at("u_share"), model ? logit(model.share) : 0);
  }

  private valuesOf(values: Float64Array): WebGLTexture {
    let made = this.values.get(values);
    if (!made) {
      const padded = new Float32Array(VALUES * VALUES);
      padded.set(values);
      this.values.set(values, (made = this.table(VALUES, VALUES, padded)));
    }
    return made;
  }

  private table(width: number, height: number, values: Float32Array<ArrayBuffer>): WebGLTexture {
    this.uploaded(values.byteLength);
    return floats(this.gl, width, height, values);
  }
}

/** Logarithms of the widths of credible intervals of Beta(a, b), a along a row. */
function widths(): Float32Array<ArrayBuffer> {
  const { side, first, last } = WIDTHS;
  const values = new Float32Array(side * side);
  const weight = (i: number): number => Math.exp(first + ((last - first) * i) / (side - 1));
  for (let i = 0; i < side; i++) {
    for (let j = 0; j <= i; j++) {
      // The interval of Beta(b, a) is that of Beta(a, b), seen in a mirror.
      values[j * side + i] = values[i * side + j] = Math.log(width(weight(i), weight(j)));
    }
  }
  return values;
}

/** The width to a thousandth, for colours; of heavy weights that of the normal distribution. */
function width(a: number, b: number): number {
  if (Math.min(a, b) > 200) return 2 * 1.959964 * Math.sqrt((a * b) / (a + b + 1)) / (a + b);
  const [low, high] = betaInterval(a, b, LEVEL, 24);
  return Math.max(high - low, 1e-30);
}

function numbersOf(model: CountModel): Float32Array<ArrayBuffer> {
  return new Float32Array([...model.distributions, model.log_reflect, model.log_miss, model.occupied].flat());
}
