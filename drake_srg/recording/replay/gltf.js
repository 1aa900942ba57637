// Reads an animated GLB file, and poses its nodes at a time.

const EXTRAS = "drake_srg";
const SIZES = { SCALAR: 1, VEC3: 3, VEC4: 4 };
const ARRAYS = { 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };

class Gltf {
  constructor(buffer) {
    const header = new DataView(buffer);
    const length = header.getUint32(12, true);
    this.buffer = buffer;
    this.start = 20 + length + 8;
    this.json = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, length)));
    this.extras = this.json.scenes[0].extras?.[EXTRAS] ?? {};
    // The last node turns the world (z up) into glTF's (y up). Here, z stays up.
    this.nodes = this.json.nodes.slice(0, -1).map((node) => ({
      name: node.name,
      mesh: node.mesh,
      camera: node.camera === undefined ? null : this.json.cameras[node.camera].perspective,
      extras: node.extras?.[EXTRAS] ?? {},
      translation: [...(node.translation ?? [0, 0, 0])],
      rotation: [...(node.rotation ?? [0, 0, 0, 1])],
      scale: [...(node.scale ?? [1, 1, 1])],
      weights: [...(this.json.meshes?.[node.mesh]?.weights ?? [])],
      tracks: [],
    }));
    for (const animation of this.json.animations ?? []) {
      for (const { sampler, target } of animation.channels) {
        const { input, output } = animation.samplers[sampler];
        this.nodes[target.node].tracks.push({
          path: target.path, time: this.array(input), values: this.array(output),
        });
      }
    }
  }

  view(index) {
    const { byteOffset = 0, byteLength } = this.json.bufferViews[index];
    return new Uint8Array(this.buffer, this.start + byteOffset, byteLength);
  }

  array(index) {
    const { bufferView, componentType, count, type } = this.json.accessors[index];
    const { byteOffset = 0 } = this.json.bufferViews[bufferView];
    // A copy, because the file's arrays need not be aligned in memory.
    const Kind = ARRAYS[componentType];
    const length = count * SIZES[type] * Kind.BYTES_PER_ELEMENT;
    const from = this.start + byteOffset;
    return new Kind(this.buffer.slice(from, from + length));
  }

  pose(time) {
    for (const node of this.nodes) {
      for (const track of node.tracks) interpolate(track, time, node[track.path]);
    }
  }
}

function interpolate({ path, time, values }, now, out) {
  const size = out.length;
  let low = 0, high = time.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (time[middle] <= now) low = middle; else high = middle;
  }
  const step = time[high] - time[low];
  const part = step > 0 ? Math.min(Math.max((now - time[low]) / step, 0), 1) : 0;
  for (let i = 0; i < size; i++) {
    out[i] = (1 - part) * values[low * size + i] + part * values[high * size + i];
  }
  if (path === "rotation") {  // samples are so close that this is as good as slerp
    const norm = Math.hypot(...out);
    for (let i = 0; i < 4; i++) out[i] /= norm;
  }
}

// Matrices of 4 x 4, by columns.

function matrixOf({ translation: p, rotation: [x, y, z, w], scale: s }) {
  return [
    s[0] * (1 - 2 * (y * y + z * z)), s[0] * 2 * (x * y + z * w), s[0] * 2 * (x * z - y * w), 0,
    s[1] * 2 * (x * y - z * w), s[1] * (1 - 2 * (x * x + z * z)), s[1] * 2 * (y * z + x * w), 0,
    s[2] * 2 * (x * z + y * w), s[2] * 2 * (y * z - x * w), s[2] * (1 - 2 * (x * x + y * y)), 0,
    ...p, 1,
  ];
}

function product(a, b) {
  const c = new Array(16).fill(0);
  for (let j = 0; j < 4; j++) for (let i = 0; i < 4; i++) for (let k = 0; k < 4; k++) {
    c[4 * j + i] += a[4 * k + i] * b[4 * j + k];
  }
  return c;
}

function perspective(fovY, aspect, near, far) {
  const f = 1 / Math.tan(fovY / 2);
  const m = new Array(16).fill(0);
  m[0] = f / aspect;
  m[5] = f;
  m[10] = (far + near) / (near - far);
  m[11] = -1;
  m[14] = 2 * far * near / (near - far);
  return m;
}

function orthographic(radius, depth) {
  const m = new Array(16).fill(0);
  m[0] = m[5] = 1 / radius;
  m[10] = -1 / depth;
  m[15] = 1;
  return m;
}

const plus = (a, b, factor = 1) => a.map((x, i) => x + factor * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];
const unit = (a) => a.map((x) => x / Math.hypot(...a));

// Transform from world to an eye that looks along `forward`, with z up.
function lookAlong(eye, forward) {
  const right = unit(cross(forward, [0, 0, 1])), up = cross(right, forward);
  return [
    right[0], up[0], -forward[0], 0, right[1], up[1], -forward[1], 0,
    right[2], up[2], -forward[2], 0, -dot(right, eye), -dot(up, eye), dot(forward, eye), 1,
  ];
}
