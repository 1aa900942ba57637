// Draws the scene with WebGL 2: light with a shadow, cameras' frusta, forces.

const VERTEX = `#version 300 es
layout(location=0) in vec3 point;
layout(location=1) in vec3 normal;
uniform mat4 model, world, light;
out vec3 place, across;
out vec4 lit;
void main() {
  vec4 p = model * vec4(point, 1.0);
  place = p.xyz;
  across = transpose(inverse(mat3(model) + mat3(1e-9))) * normal;
  lit = light * p;
  gl_Position = world * p;
}`;
const FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
in vec3 place, across;
in vec4 lit;
uniform vec4 color;
uniform vec3 eye, sun, background;
uniform float shine, haze;
uniform sampler2DShadow shadow;
out vec4 pixel;
void main() {
  vec3 n = normalize(across), v = normalize(eye - place);
  if (dot(n, v) < 0.0) n = -n;
  float open = 1.0;
  vec3 at = 0.5 * lit.xyz + 0.5;
  if (all(lessThan(abs(lit.xyz), vec3(0.98)))) {
    open = 0.0;
    float slope = 0.0012 + 0.004 * (1.0 - max(dot(n, sun), 0.0));
    for (int i = -1; i <= 1; i++) for (int j = -1; j <= 1; j++)
      open += texture(shadow, vec3(at.xy + vec2(i, j) / 1500.0, at.z - slope)) / 9.0;
  }
  vec3 sky = mix(vec3(0.30, 0.29, 0.28), vec3(0.56, 0.58, 0.62), 0.5 + 0.5 * n.z);
  float direct = max(dot(n, sun), 0.0) * open;
  float gloss = pow(max(dot(n, normalize(sun + v)), 0.0), 40.0) * open * 0.18;
  float rim = 0.08 * pow(1.0 - max(dot(n, v), 0.0), 3.0);
  vec3 shaded = color.rgb * (sky + 0.62 * direct) + gloss + rim * color.rgb;
  shaded = mix(shaded, color.rgb, shine);
  shaded = pow(clamp(shaded, 0.0, 1.0), vec3(1.0 / 2.2));
  float far = smoothstep(0.6 * haze, haze, length(eye - place));
  pixel = vec4(mix(shaded, background, far), color.a);
}`;
const DEPTH_ONLY = `#version 300 es
precision highp float;
void main() {}`;
const SUN = unit([0.45, -0.5, 1.0]);
const SHADOW = 1536;  // pixels

class View {
  constructor(canvas, gltf) {
    this.canvas = canvas;
    this.gltf = gltf;
    this.show = { forces: true, cameras: true };
    const gl = this.gl = canvas.getContext("webgl2", { antialias: true });
    if (!gl) throw new Error("this browser has no WebGL 2");
    this.shaded = this.program(VERTEX, FRAGMENT);
    this.dark = this.program(VERTEX, DEPTH_ONLY);
    this.meshes = (gltf.json.meshes ?? []).map((mesh) => mesh.primitives.map(
      (primitive) => this.upload(primitive)));
    this.frustum = this.wires();
    this.makeShadow();
    gltf.pose(0);
    this.focus = this.middle();
    this.reset();
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new Error(gl.getProgramInfoLog(program));
    }
    const uniforms = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
      const { name } = gl.getActiveUniform(program, i);
      uniforms[name] = gl.getUniformLocation(program, name);
    }
    return { program, uniforms };
  }

  upload({ attributes, indices, material, targets = [] }) {
    const { gl, gltf } = this;
    const points = gltf.array(attributes.POSITION), faces = gltf.array(indices);
    const color = gltf.json.materials[material].pbrMetallicRoughness.baseColorFactor;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffer = this.fill(0, points);
    this.fill(1, gltf.array(attributes.NORMAL));
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    const low = [0, 1, 2].map((k) => points.reduce((m, x, i) => i % 3 === k ? Math.min(m, x) : m, Infinity));
    const high = [0, 1, 2].map((k) => points.reduce((m, x, i) => i % 3 === k ? Math.max(m, x) : m, -Infinity));
    return {
      array, buffer, points, color, low, high, count: faces.length,
      kind: faces.BYTES_PER_ELEMENT === 2 ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT,
      targets: targets.map((target) => gltf.array(target.POSITION)),
    };
  }

  fill(location, values) {
    const gl = this.gl, buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 0, 0);
    return buffer;
  }

  // Edges of a pyramid with its top at the origin and its base, from -1 to 1, at z = -1.
  wires() {
    const gl = this.gl, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const corners = [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]];
    const lines = corners.flatMap((corner, i) => [
      [0, 0, 0], corner, corner, corners[(i + 1) % 4]]);
    const mark = [[-0.3, 1.1, -1], [0, 1.4, -1], [0, 1.4, -1], [0.3, 1.1, -1]];  // up
    const points = new Float32Array([...lines, ...mark].flat());
    this.fill(0, points);
    this.fill(1, points);
    return { array, count: points.length / 3 };
  }

  makeShadow() {
    const gl = this.gl;
    this.depth = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.depth);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW, SHADOW);
    for (const [key, value] of [
      [gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
      [gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    ]) gl.texParameteri(gl.TEXTURE_2D, key, value);
    this.target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.depth, 0);
    gl.drawBuffers([gl.NONE]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  // Middle and radius of everything that moves or, if nothing moves, of everything.
  middle() {
    const bounds = (nodes) => {
      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      for (const node of nodes) {
        const m = matrixOf(node);
        for (const part of this.meshes[node.mesh] ?? []) {
          for (const x of [part.low[0], part.high[0]]) for (const y of [part.low[1], part.high[1]])
            for (const z of [part.low[2], part.high[2]]) for (let k = 0; k < 3; k++) {
              const at = m[k] * x + m[4 + k] * y + m[8 + k] * z + m[12 + k];
              low[k] = Math.min(low[k], at);
              high[k] = Math.max(high[k], at);
            }
        }
      }
      return low.every(isFinite) && { point: plus(low, high).map((x) => x / 2),
                                      radius: Math.hypot(...plus(high, low, -1)) / 2 };
    };
    const bodies = this.gltf.nodes.filter((node) => !node.extras.force);
    return bounds(bodies.filter((node) => node.tracks.length)) || bounds(bodies) ||
      { point: [0, 0, 0], radius: 1 };
  }

  // Take the view of the video's camera or, without a video, look at everything that moves.
  reset() {
    const { point, radius } = this.focus;
    const camera = this.gltf.nodes.find(
      (node) => node.camera && node.extras.camera === this.gltf.extras.video_camera);
    if (camera) {
      const m = matrixOf(camera), eye = camera.translation;
      const forward = [-m[8], -m[9], -m[10]];
      this.distance = Math.max(dot(plus(point, eye, -1), forward), 0.2);
      this.at = plus(eye, forward, this.distance);
      this.pitch = Math.asin(-forward[2]);
      this.yaw = Math.atan2(-forward[1], -forward[0]);
      this.fov = camera.camera.yfov;
      this.aspect = camera.camera.aspectRatio;
    } else {
      Object.assign(this, {
        at: [...point], distance: 3 * radius, pitch: 0.45, yaw: -0.9, fov: 0.7, aspect: 1.5,
      });
    }
  }

  get forward() {
    const { pitch, yaw } = this;
    return [-Math.cos(pitch) * Math.cos(yaw), -Math.cos(pitch) * Math.sin(yaw), -Math.sin(pitch)];
  }

  get eye() { return plus(this.at, this.forward, -this.distance); }

  turn(right, up) {
    this.yaw -= right;
    this.pitch = Math.min(Math.max(this.pitch + up, -1.5), 1.5);
  }

  // Move by a share of the picture's height.
  pan(right, up) {
    const forward = this.forward, aside = unit(cross(forward, [0, 0, 1]));
    const size = 2 * Math.tan(this.fov / 2) * this.distance;
    this.at = plus(plus(this.at, aside, -right * size), cross(aside, forward), -up * size);
  }

  zoom(factor) { this.distance = Math.min(Math.max(this.distance * factor, 0.05), 30); }

  draw(background) {
    const { gl, canvas } = this;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(Math.round(canvas.clientWidth * ratio), 1);
    const height = Math.max(Math.round(canvas.clientHeight * ratio), 1);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    this.morph();
    const { point, radius } = this.focus;
    const light = product(orthographic(1.5 * radius, 2 * radius), lookAlong(point, SUN.map((x) => -x)));
    gl.enable(gl.DEPTH_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(0, 0, SHADOW, SHADOW);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    this.use(this.dark, { world: light, light });
    this.drawNodes((node, part) => !node.extras.force && part.color[3] > 0.9);

    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    // A narrow picture shows at least 80 % of the width of the video's picture.
    const widen = Math.max(1, 0.8 * this.aspect * height / width);
    const fov = 2 * Math.atan(Math.tan(this.fov / 2) * widen);
    const near = 0.02 * this.distance, eye = this.eye;
    this.world = product(perspective(fov, width / height, near, 60 + this.distance),
                         lookAlong(eye, this.forward));
    this.use(this.shaded, { world: this.world, light });
    const { uniforms } = this.shaded;
    gl.uniform3fv(uniforms.eye, eye);
    gl.uniform3fv(uniforms.sun, SUN);
    gl.uniform3fv(uniforms.background, background);
    gl.uniform1f(uniforms.haze, 6 * radius + 1.5 * this.distance);
    gl.uniform1f(uniforms.shine, 0);
    gl.bindTexture(gl.TEXTURE_2D, this.depth);
    this.drawNodes((node, part) => !node.extras.force && part.color[3] >= 1);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    this.drawNodes((node, part) => !node.extras.force && part.color[3] < 1);
    gl.uniform1f(uniforms.shine, 0.8);
    if (this.show.cameras) this.drawCameras(eye);
    if (this.show.forces) {  // faint where something hides them
      gl.disable(gl.DEPTH_TEST);
      this.drawNodes((node) => node.extras.force, 0.45);
      gl.enable(gl.DEPTH_TEST);
      this.drawNodes((node) => node.extras.force);
    }
    gl.disable(gl.BLEND);
  }

  use({ program, uniforms }, matrices) {
    this.gl.useProgram(program);
    this.uniforms = uniforms;
    for (const [name, m] of Object.entries(matrices)) this.gl.uniformMatrix4fv(uniforms[name], false, m);
  }

  drawNodes(chosen, opacity = 1) {
    const gl = this.gl;
    for (const node of this.gltf.nodes) {
      if (node.scale[2] === 0) continue;
      const model = matrixOf(node);
      for (const part of this.meshes[node.mesh] ?? []) {
        if (!chosen(node, part)) continue;
        gl.uniformMatrix4fv(this.uniforms.model, false, model);
        const [r, g, b, a] = part.color;
        if (this.uniforms.color) gl.uniform4f(this.uniforms.color, r, g, b, a * opacity);
        gl.bindVertexArray(part.array);
        gl.drawElements(gl.TRIANGLES, part.count, part.kind, 0);
      }
    }
  }

  drawCameras(eye) {
    const gl = this.gl;
    gl.bindVertexArray(this.frustum.array);
    gl.uniform4f(this.uniforms.color, 0.1, 0.35, 0.6, 1);
    for (const node of this.gltf.nodes) {
      if (!node.camera || Math.hypot(...plus(node.translation, eye, -1)) < 0.25) continue;
      const size = 0.12, half = size * Math.tan(node.camera.yfov / 2);
      const scale = [half * node.camera.aspectRatio, half, size];
      gl.uniformMatrix4fv(this.uniforms.model, false, matrixOf({ ...node, scale }));
      gl.drawArrays(gl.LINES, 0, this.frustum.count);
    }
  }

  morph() {
    const gl = this.gl;
    for (const node of this.gltf.nodes) {
      if (!node.weights.length) continue;
      for (const part of this.meshes[node.mesh]) {
        const points = Float32Array.from(part.points);
        part.targets.forEach((target, k) => {
          for (let i = 0; i < points.length; i++) points[i] += node.weights[k] * target[i];
        });
        gl.bindBuffer(gl.ARRAY_BUFFER, part.buffer);
        gl.bufferData(gl.ARRAY_BUFFER, points, gl.DYNAMIC_DRAW);
      }
    }
  }
}
