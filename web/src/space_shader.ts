// SPDX-License-Identifier: Apache-2.0
// One point for each voxel. The point covers the voxel's box on the screen, and each of its pixels
// finds out where its ray meets that box: so a voxel costs one vertex, and its depth is exact. Cells of
// a slice are boxes without a height. Free voxels are plain points. A point has a largest size, and goes
// with its middle at the edge of the screen: near voxels of which that is true are drawn by their faces.

import { STOPS } from "./colours";
import { POSTERIOR } from "./posterior_shader";

/** What a program draws. */
export const DRAWS = { boxes: 0, points: 1, slice: 2 } as const;

export const PAINTS = { height: 0, probability: 1, hits: 2, reflection: 3, "interval-width": 4 } as const;

export const SPACE_VERTEX = `#version 300 es
precision highp float;
precision highp int;
layout(location = 0) in vec3 a_place;
layout(location = 1) in vec2 a_counts;
uniform float u_unit;        // votes in one count
uniform vec3 u_eye;          // whole voxels
uniform vec3 u_within;       // and what is left of it
uniform mat3 u_view;         // from the map to the view: right, up, back
uniform float u_focal;       // pixels in a tangent of 1
uniform vec2 u_screen;       // pixels
uniform vec2 u_range;        // nearest and farthest depth
uniform float u_largest;     // point that the graphics card draws
uniform vec3 u_lo;           // the clip box: first voxel
uniform vec3 u_hi;           // and one past the last
uniform int u_draw;
uniform bool u_near;         // near voxels, by their faces
uniform vec2 u_opacity;       // of free voxels, and of others
uniform vec3 u_half;         // half of a box
uniform int u_paint;
uniform vec2 u_heights;      // lowest and highest voxel of the ramp
uniform vec3 u_free;         // colour of free voxels
uniform float u_most;        // hits at the end of the ramp, as log(1 + hits)
flat out vec3 v_middle;      // from the eye, in the axes of the map
flat out vec4 v_colour;
flat out float v_pixels;
${POSTERIOR}
const float POINT = 0.3;     // of a voxel's side


void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = 1.0;
  v_middle = vec3(0.0);
  v_colour = vec4(0.0);
  v_pixels = 0.0;
  if (any(lessThan(a_place, u_lo)) || any(greaterThanEqual(a_place, u_hi))) return;
  vec2 votes = a_counts * u_unit;
  float value = value_of(votes);
  bool occupied = value >= u_thresholds.y;
  if (u_draw == ${DRAWS.boxes} && !occupied) return;
  // Occupied voxels that are boxes are no points; those without a hit are no boxes.
  if (u_draw == ${DRAWS.points} && occupied && votes.x > 0.0) return;
  v_middle = a_place - u_eye + (0.5 - u_within);
  vec3 seen = u_view * v_middle;
  float depth = -seen.z;
  // Half the box along each axis of the view.
  vec3 half_box = abs(u_view[0]) * u_half.x + abs(u_view[1]) * u_half.y + abs(u_view[2]) * u_half.z;
  float nearest = depth - half_box.z;
  if (nearest < u_range.x && !u_near) return;
  vec2 reach = (half_box.xy + half_box.z * abs(seen.xy) / depth) / nearest;
  v_pixels = nearest < u_range.x ? 1e6 : 2.0 * u_focal * max(reach.x, reach.y);
  gl_PointSize = clamp(v_pixels + 1.0, 1.0, u_largest);
  vec4 position = vec4(2.0 * u_focal * seen.xy / u_screen, 0.0, depth);
  if (u_near) {
    if (v_pixels + 1.0 <= u_largest && all(lessThanEqual(abs(position.xy), vec2(depth)))) return; // a point
    // Six vertices for the face along each axis that looks at the eye, if one does.
    int axis = gl_VertexID / 6;
    int at = gl_VertexID % 6;
    int number = at < 3 ? at : at - 2;
    if (abs(v_middle[axis]) <= u_half[axis]) return;
    vec3 side = vec3(0.0);
    side[axis] = -sign(v_middle[axis]);
    side[(axis + 1) % 3] = float(number & 1) * 2.0 - 1.0;
    side[(axis + 2) % 3] = float(number >> 1) * 2.0 - 1.0;
    vec3 corner = u_view * (v_middle + side * u_half);
    position = vec4(2.0 * u_focal * corner.xy / u_screen, 0.0, -corner.z);
  }
  gl_Position = position;
  if (u_draw == ${DRAWS.slice}) {
    v_colour = vec4(colour_of(value) / 255.0, 1.0);
    return;
  }
  if (u_draw == ${DRAWS.points}) {
    v_pixels = 0.0;
    gl_PointSize = clamp(POINT * u_focal / depth, 1.0, u_largest);
    bool free = value <= u_thresholds.x;
    v_colour = free ? vec4(u_free / 255.0, u_opacity.x)
      : vec4((occupied ? u_ramp[${STOPS - 1}] : u_undecided) / 255.0, u_opacity.y);
    if (v_colour.a == 0.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    return;
  }
  float shade = u_paint == ${PAINTS.height} ? (a_place.z - u_heights.x) / max(u_heights.y - u_heights.x, 1.0)
    : u_paint == ${PAINTS.hits} ? log(1.0 + votes.x) / u_most
    : u_paint == ${PAINTS.reflection} ? share_of(votes)
    : u_paint == ${PAINTS["interval-width"]} ? interval_width(u_beta + votes)
    : (value - u_thresholds.y) / max(1.0 - u_thresholds.y, 1e-6);
  v_colour = vec4(ramp(shade) / 255.0, 1.0);
}`;

export const SPACE_FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
flat in vec3 v_middle;
flat in vec4 v_colour;
flat in float v_pixels;
uniform int u_draw;
uniform bool u_near;
uniform vec3 u_half;
uniform mat3 u_view;
uniform float u_focal;
uniform vec2 u_screen;
uniform vec2 u_range;
out vec4 o_colour;

float depth_of(float depth) {
  float near = u_range.x;
  float far = u_range.y;
  return clamp(far * (depth - near) / (depth * (far - near)), 0.0, 1.0);
}

void main() {
  // Towards the pixel, by one along the depth.
  vec3 ray = vec3((gl_FragCoord.xy - 0.5 * u_screen) / u_focal, -1.0) * u_view;
  if (u_draw == ${DRAWS.points}) {
    o_colour = v_colour;
    gl_FragDepth = depth_of(-(u_view * v_middle).z);
    return;
  }
  ray = mix(ray, vec3(1e-7), lessThan(abs(ray), vec3(1e-7)));
  vec3 nearer = (v_middle - u_half * sign(ray)) / ray;
  vec3 farther = (v_middle + u_half * sign(ray)) / ray;
  float enter = max(max(nearer.x, nearer.y), nearer.z);
  float leave = min(min(farther.x, farther.y), farther.z);
  // A voxel that is hardly a pixel is drawn whole: a ray through the pixel's middle might miss it.
  // Faces cover what they should.
  if (enter > leave && v_pixels > 1.5 && !u_near) discard;
  float depth = max(min(enter, leave), u_range.x);
  vec3 at = abs(ray * depth - v_middle);
  float largest = max(max(at.x, at.y), at.z);
  float brightness = 1.0;
  float beside = largest;
  if (u_draw == ${DRAWS.boxes}) {
    brightness = nearer.z >= enter ? (ray.z < 0.0 ? 1.0 : 0.55) : nearer.x >= enter ? 0.84 : 0.7;
    beside = at.x + at.y + at.z - largest - min(min(at.x, at.y), at.z);
  }
  // Edges of boxes that are large enough to have some.
  float edge = smoothstep(0.5 - 1.5 / max(v_pixels, 1.0), 0.5, beside) * smoothstep(6.0, 24.0, v_pixels);
  o_colour = vec4(v_colour.rgb * brightness * (1.0 - 0.35 * edge), 1.0);
  gl_FragDepth = depth_of(depth);
}`;

/** What is unknown in a slice: a rectangle, of which four corners are drawn. */
export const GROUND_VERTEX = `#version 300 es
precision highp float;
uniform vec3 u_eye;
uniform vec3 u_within;
uniform mat3 u_view;
uniform float u_focal;
uniform vec2 u_screen;
uniform vec2 u_range;
uniform vec4 u_sides;        // x and y from, x and y to
uniform float u_height;

void main() {
  vec2 corner = mix(u_sides.xy, u_sides.zw, vec2(gl_VertexID & 1, gl_VertexID >> 1));
  vec3 seen = u_view * (vec3(corner, u_height) - u_eye - u_within);
  float depth = -seen.z;
  float near = u_range.x;
  float far = u_range.y;
  gl_Position = vec4(2.0 * u_focal * seen.xy / u_screen, 2.0 * far * (depth - near) / (far - near) - depth, depth);
}`;

export const GROUND_FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 u_colour;
out vec4 o_colour;
void main() {
  o_colour = vec4(u_colour / 255.0, 1.0);
}`;
