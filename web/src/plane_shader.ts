// SPDX-License-Identifier: Apache-2.0
// Each pixel of a 2D map: the counts of its cell, or of the most telling of its cells.

import { POSTERIOR } from "./posterior_shader";

/** One triangle that covers the screen. */
export const VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

/** @param whole whether textures hold whole numbers of counts, or votes as floats. */
export const fragmentShader = (whole: boolean): string => `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp ${whole ? "u" : ""}sampler2DArray;

uniform ${whole ? "u" : ""}sampler2DArray u_counts;
uniform usampler2D u_table;
uniform float u_unit;        // votes in one count
uniform int u_tile;          // cells along a tile
uniform int u_across;        // tiles along the side of a layer of the texture
uniform ivec2 u_cell;        // the cell in the middle of the screen, counted from the first tile
uniform vec2 u_within;       // where in it the middle lies
uniform vec2 u_middle;       // the same in pixels
uniform float u_scale;       // cells in a pixel
uniform int u_block;         // cells along the side of what is shown in one colour
uniform bool u_probe;        // the value itself, in 24 bits
uniform vec3 u_unknown;

out vec4 o_colour;
${POSTERIOR}
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
        sum += part_of(v);
        seen += 1.0;
      }
    }
  }
  float value = value_of(most);
  if (seen > 1.0 && value < 0.5) value = mean_of(sum, seen);
  if (u_probe) {
    uint bits = min(uint(value * 16777215.0 + 0.5), 16777215u);
    uvec3 bytes = uvec3(bits >> 16u, (bits >> 8u) & 255u, bits & 255u);
    o_colour = vec4(vec3(bytes) / 255.0, seen > 0.0 ? 1.0 : 0.0);
    return;
  }
  o_colour = vec4((seen > 0.0 ? colour_of(value) : u_unknown) / 255.0, 1.0);
}`;
