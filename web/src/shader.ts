// SPDX-License-Identifier: Apache-2.0
// Every pixel's posterior, from the counts of its cell. Whatever a slider changes is a uniform.

import { STOPS } from "./colours";

/** One triangle that covers the screen. */
export const VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

/** Side of the table of interval widths, and the logarithms of the weights at its first and last. */
export const WIDTHS = { side: 128, first: Math.log(1e-2), last: Math.log(1e6) } as const;

/** Values of a distribution of reflectivities, and how many distributions a model has. */
export const MODEL = { values: 48, knots: 8 } as const;

export const POSTERIORS = { "log-odds": 0, calibrated: 1, reflection: 2, "interval-width": 3 } as const;

/** @param whole whether textures hold whole numbers of counts, or votes as floats. */
export const fragmentShader = (whole: boolean): string => `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp ${whole ? "u" : ""}sampler2DArray;

uniform ${whole ? "u" : ""}sampler2DArray u_counts;
uniform usampler2D u_table;
uniform sampler2D u_widths;
uniform sampler2D u_model;
uniform float u_unit;        // votes in one count
uniform int u_tile;          // cells along a tile
uniform int u_across;        // tiles along the side of a layer of the texture
uniform ivec2 u_cell;        // the cell in the middle of the screen, counted from the first tile
uniform vec2 u_within;       // where in it the middle lies
uniform vec2 u_middle;       // the same in pixels
uniform float u_scale;       // cells in a pixel
uniform int u_block;         // cells along the side of what is shown in one colour
uniform int u_posterior;
uniform bool u_states;
uniform bool u_probe;        // the value itself, in 24 bits
uniform float u_prior;       // log odds
uniform vec2 u_rates;        // log odds that a hit adds, and a pass
uniform vec2 u_clamp;        // lowest and highest log odds
uniform vec2 u_beta;         // weights of the Beta prior
uniform vec2 u_thresholds;   // free, occupied
uniform vec3 u_ramp[${STOPS}];
uniform vec3 u_unknown;
uniform vec3 u_undecided;
uniform float u_share;       // log odds of the share of occupied cells that the model knows

out vec4 o_colour;

// Where the counts of a cell are, and in which layer: -1 where there are none.
ivec3 texel_of(ivec2 cell) {
  ivec2 place = cell / u_tile;
  if (any(lessThan(cell, ivec2(0))) || any(greaterThanEqual(place, textureSize(u_table, 0)))) {
    return ivec3(-1);
  }
  int number = int(texelFetch(u_table, place, 0).r) - 1;
  if (number < 0) return ivec3(-1);
  int row = number / u_across;
  ivec2 corner = ivec2(number % u_across, row % u_across) * u_tile;
  return ivec3(corner + cell - place * u_tile, row / u_across);
}

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

float value_of(vec2 v) {
  if (u_posterior == ${POSTERIORS.reflection}) return (u_beta.x + v.x) / (u_beta.x + u_beta.y + v.x + v.y);
  if (u_posterior == ${POSTERIORS["interval-width"]}) return interval_width(u_beta + v);
  float evidence = u_posterior == ${POSTERIORS.calibrated} ? bayes_factor(v) : dot(u_rates, v);
  return sigmoid(clamp(u_prior + evidence, u_clamp.x, u_clamp.y));
}

// What tells the most occupied of some cells: of log odds and of reflectivities it does exactly, and
// the calibrated posterior is theirs by reflectivity, too.
float score_of(vec2 v) {
  if (u_posterior == ${POSTERIORS["log-odds"]}) return dot(u_rates, v);
  return (u_beta.x + v.x) / (u_beta.x + u_beta.y + v.x + v.y);
}

vec3 ramp(float value) {
  float place = clamp(value, 0.0, 1.0) * ${STOPS - 1}.0;
  int below = min(int(place), ${STOPS - 2});
  return mix(u_ramp[below], u_ramp[below + 1], place - float(below));
}

void main() {
  vec2 from_middle = (gl_FragCoord.xy - u_middle) * u_scale + u_within;
  ivec2 cell = u_cell + ivec2(floor(from_middle));
  // Of many cells the most occupied one where it is rather occupied than free, else their mean: so
  // no wall is lost between pixels. All of them lie in one tile.
  ivec2 corner = cell - (cell & ivec2(u_block - 1));
  ivec3 first = texel_of(corner);
  vec2 most = vec2(0.0);
  vec2 sum = vec2(0.0);
  float best = -1e38;
  float seen = 0.0;
  if (first.z >= 0) {
    for (int y = 0; y < u_block; y++) {
      for (int x = 0; x < u_block; x++) {
        vec2 v = vec2(texelFetch(u_counts, first + ivec3(x, y, 0), 0).rg) * u_unit;
        if (v.x + v.y <= 0.0) continue;
        float score = score_of(v);
        if (score > best) {
          best = score;
          most = v;
        }
        sum += v;
        seen += 1.0;
      }
    }
  }
  float value = value_of(most);
  if (seen > 1.0 && value < 0.5) value = value_of(sum / seen);
  if (u_probe) {
    uint bits = min(uint(value * 16777215.0 + 0.5), 16777215u);
    o_colour = vec4(float(bits >> 16u), float((bits >> 8u) & 255u), float(bits & 255u), seen > 0.0 ? 255.0 : 0.0) / 255.0;
    return;
  }
  vec3 colour = ramp(value);
  if (u_states) {
    colour = value >= u_thresholds.y ? u_ramp[${STOPS - 1}] : value <= u_thresholds.x ? u_ramp[0] : u_undecided;
  }
  o_colour = vec4((seen > 0.0 ? colour : u_unknown) / 255.0, 1.0);
}`;
