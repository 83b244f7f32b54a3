"use strict";
// The surface in WebGL 2: a mesh with textures, or with a colour per vertex; cameras as lines, an orbit around it.

const vertexShader = `#version 300 es
in vec3 position; in vec3 normal; in vec3 colour; in vec2 place;
uniform mat4 clipFromScene;
out vec3 shownPosition; out vec3 shownNormal; out vec3 shownColour; out vec2 shownPlace;
void main() {
  shownPosition = position; shownNormal = normal; shownColour = colour; shownPlace = place;
  gl_Position = clipFromScene * vec4(position, 1.0);
}`;

const fragmentShader = `#version 300 es
precision highp float;
in vec3 shownPosition; in vec3 shownNormal; in vec3 shownColour; in vec2 shownPlace;
uniform int kind; uniform vec3 lamp; uniform vec3 flat_colour;
uniform bool textured; uniform sampler2D map; uniform sampler2D relief;
out vec4 pixel;
vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 srgb(vec3 c) { return mix(c * 12.92, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }
vec3 withRelief(vec3 n) { // the frame of the texture, by how it changes from pixel to pixel; the map's y is against v
  vec3 acrossX = dFdx(shownPosition), acrossY = dFdy(shownPosition);
  vec2 placeX = dFdx(shownPlace), placeY = dFdy(shownPlace);
  vec3 ofX = cross(acrossY, n), ofY = cross(n, acrossX);
  float front = dot(acrossX, ofX) < 0.0 ? -1.0 : 1.0;
  vec3 t = front * (ofX * placeX.x + ofY * placeY.x), b = front * (ofX * placeX.y + ofY * placeY.y);
  float size = max(dot(t, t), dot(b, b));
  if (size == 0.0) return n;
  vec3 d = 2.0 * texture(relief, shownPlace).xyz - 1.0;
  return normalize((t * d.x - b * d.y) * inversesqrt(size) + n * d.z);
}
void main() {
  vec3 n = normalize(shownNormal), colour = shownColour;
  if (textured) { n = withRelief(n); colour = texture(map, shownPlace).rgb; }
  if (kind == 0) pixel = vec4(colour, 1.0);
  else if (kind == 1) pixel = vec4(0.5 * n + 0.5, 1.0);
  else if (kind == 2) pixel = vec4(vec3(colour.r), 1.0);
  else if (kind == 3) {
    float light = 0.12 + 1.1 * max(dot(n, lamp), 0.0);
    pixel = vec4(srgb(min(linear(colour) * light, vec3(1.0))), 1.0);
  } else pixel = vec4(flat_colour, 1.0);
}`;

function bytesOf(id) {
  const text = atob(document.getElementById(id).textContent);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

// matrices, column by column

function product(a, b) {
  const c = new Float32Array(16);
  for (let i = 0; i < 4; i++)
    for (let j = 0; j < 4; j++)
      for (let k = 0; k < 4; k++) c[4 * j + i] += a[4 * k + i] * b[4 * j + k];
  return c;
}

const slope = Math.tan(0.35); // of half the angle of view, along the shorter side

function perspective(ratio) {
  const f = 1 / slope, near = 0.01, far = 60;
  const [x, y] = ratio > 1 ? [f / ratio, f] : [f, f * ratio]; // the shorter side has the angle of view
  return new Float32Array([x, 0, 0, 0, 0, y, 0, 0,
    0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0]);
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((value) => value / Math.hypot(...a));

function lookAt(eye, target) {
  const back = unit(eye.map((value, i) => value - target[i]));
  const right = unit(cross([0, 1, 0], back)), up = cross(back, right);
  return new Float32Array([right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1]);
}

function direction(azimuth, elevation) {
  return [Math.sin(azimuth) * Math.cos(elevation), Math.sin(elevation), Math.cos(azimuth) * Math.cos(elevation)];
}

// the model on the card

function compiled(gl) {
  const program = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, vertexShader], [gl.FRAGMENT_SHADER, fragmentShader]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  ["position", "normal", "colour", "place"].forEach((name, place) => gl.bindAttribLocation(program, place, name));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  return program;
}

function loaded(gl, about, bytes) {
  const n = about.vertices;
  let start = 0;
  const block = (length) => {
    const part = bytes.subarray(start, start + length);
    start += length;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, part, gl.STATIC_DRAW);
    return buffer;
  };
  const buffers = { position: block(6 * n), normal: block(3 * n) };
  if (about.textures.length) buffers.place = block(4 * n);
  else Object.assign(buffers, { albedo: block(3 * n), photo: block(3 * n), shading: block(3 * n), confidence: block(n) });
  start += (4 - start % 4) % 4;
  buffers.faces = gl.createBuffer();
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers.faces);
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, bytes.subarray(start, start + 12 * about.faces), gl.STATIC_DRAW);
  const lines = about.cameras.flatMap((camera) => frustum(camera, 0.1 * reachOf(about)));
  buffers.lines = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffers.lines);
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(lines), gl.STATIC_DRAW);
  return buffers;
}

function reachOf(about) { // of the cameras, from the middle of the surface
  const ways = about.cameras.map((one) => Math.hypot(...one.centre.map((value, i) => value - about.middle[i])));
  return ways.reduce((sum, way) => sum + way, 0) / ways.length;
}

function frustum(camera, depth) {
  const corners = camera.rays.map((ray) => ray.map((value, i) => camera.centre[i] + depth * value));
  return corners.flatMap((corner, k) => [...camera.centre, ...corner, ...corner, ...corners[(k + 1) % 4]]);
}

function distanceFor(about, positions, ratio, back) { // at which the surface fills the canvas, seen from there
  const right = unit(cross([0, 1, 0], back)), up = cross(back, right);
  const across = slope * Math.max(ratio, 1), upwards = slope / Math.min(ratio, 1);
  let distance = 0;
  for (let at = 0; at < positions.length; at += 3) {
    const from = [0, 1, 2].map((i) => positions[at + i] / 65535 - about.middle[i]);
    const beside = Math.max(Math.abs(dot(from, right)) / across, Math.abs(dot(from, up)) / upwards);
    distance = Math.max(distance, 1.05 * beside + dot(from, back));
  }
  return distance;
}

class Orbit {
  constructor(about, positions, ratio) {
    const middle = about.middle;
    const away = about.cameras[about.front].centre.map((value, i) => value - middle[i]); // as the page's first picture
    const azimuth = Math.atan2(away[0], away[2]), elevation = Math.atan2(away[1], Math.hypot(away[0], away[2]));
    const distance = distanceFor(about, positions, ratio, direction(azimuth, elevation));
    this.first = { azimuth, elevation, distance, target: middle };
    this.reset();
  }
  include(centres) { // go back until all cameras are in sight
    const reach = Math.max(...centres.map((c) => Math.hypot(...c.map((value, i) => value - this.target[i]))));
    this.distance = Math.max(this.distance, 2.8 * reach);
    this.elevation = Math.max(this.elevation, 0.5);
  }
  reset() { Object.assign(this, this.first, { target: [...this.first.target] }); }
  turn(across, down) {
    this.azimuth -= across;
    this.elevation = Math.min(1.55, Math.max(-1.55, this.elevation + down));
  }
  zoom(factor) { this.distance = Math.min(20, Math.max(0.05, this.distance / factor)); }
  move(across, down) {
    const back = direction(this.azimuth, this.elevation), right = unit(cross([0, 1, 0], back)), up = cross(back, right);
    this.target = this.target.map((value, i) => value + this.distance * (down * up[i] - across * right[i]));
  }
  get eye() {
    return direction(this.azimuth, this.elevation).map((value, i) => this.target[i] + this.distance * value);
  }
}

class SurfaceView {
  constructor(canvas, about, bytes) {
    this.canvas = canvas;
    this.about = about;
    const gl = this.gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error("no WebGL 2");
    this.program = compiled(gl);
    this.buffers = loaded(gl, about, bytes);
    this.textures = new Textures(gl, report.textures, () => this.redraw());
    const positions = new Uint16Array(bytes.buffer, 0, 3 * about.vertices);
    this.orbit = new Orbit(about, positions, canvas.clientWidth / canvas.clientHeight);
    this.view = 0;
    this.queued = false;
    gl.enable(gl.DEPTH_TEST);
    new ResizeObserver(() => this.redraw()).observe(canvas);
  }
  redraw() {
    if (this.queued) return;
    this.queued = true;
    requestAnimationFrame(() => { this.queued = false; this.draw(); });
  }
  uniform(name) { return this.gl.getUniformLocation(this.program, name); }
  attribute(place, buffer, size, type, normalized) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, normalized, 0, 0);
  }
  draw() {
    const gl = this.gl, canvas = this.canvas, scale = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * scale));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * scale));
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const orbit = this.orbit;
    const clip = product(perspective(canvas.width / canvas.height), lookAt(orbit.eye, orbit.target));
    gl.uniformMatrix4fv(this.uniform("clipFromScene"), false, clip);
    this.drawMesh();
    if (document.getElementById("frusta").checked) this.drawCameras();
    canvas.setAttribute("aria-busy", this.textures.waiting > 0);
  }
  drawMesh() {
    const gl = this.gl, chosen = document.querySelector("input[name=surface]:checked").value;
    const [azimuth, elevation] = ["lamp-azimuth", "lamp-elevation"]
      .map((id) => Number(document.getElementById(id).value) * Math.PI / 180);
    gl.uniform1i(this.uniform("kind"), { normal: 1, confidence: 2, relit: 3 }[chosen] || 0);
    gl.uniform3fv(this.uniform("lamp"), direction(azimuth + this.orbit.first.azimuth, elevation));
    this.attribute(0, this.buffers.position, 3, gl.UNSIGNED_SHORT, true);
    this.attribute(1, this.buffers.normal, 3, gl.BYTE, true);
    const shown = { photo: "photo", shading: "shading", confidence: "confidence" }[chosen] || "albedo";
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.faces);
    if (this.buffers.place) this.drawTextured(shown);
    else {
      this.attribute(2, this.buffers[shown], shown === "confidence" ? 1 : 3, gl.UNSIGNED_BYTE, true);
      gl.drawElements(gl.TRIANGLES, 3 * this.about.faces, gl.UNSIGNED_INT, 0);
    }
  }
  drawTextured(shown) {
    const gl = this.gl;
    gl.uniform1i(this.uniform("textured"), 1);
    gl.uniform1i(this.uniform("map"), 0);
    gl.uniform1i(this.uniform("relief"), 1);
    this.attribute(3, this.buffers.place, 2, gl.UNSIGNED_SHORT, true);
    let first = 0;
    this.about.textures.forEach((faces, number) => {
      this.textures.bind(1, number, "relief");
      this.textures.bind(0, number, shown);
      gl.drawElements(gl.TRIANGLES, 3 * faces, gl.UNSIGNED_INT, 12 * first);
      first += faces;
    });
    gl.disableVertexAttribArray(3);
    gl.uniform1i(this.uniform("textured"), 0);
  }
  drawCameras() {
    const gl = this.gl, quiet = [0.5, 0.48, 0.45], bold = [0.85, 0.4, 0.1];
    gl.uniform1i(this.uniform("kind"), 4);
    this.attribute(0, this.buffers.lines, 3, gl.FLOAT, false);
    gl.disableVertexAttribArray(1);
    gl.disableVertexAttribArray(2);
    gl.uniform3fv(this.uniform("flat_colour"), quiet);
    gl.drawArrays(gl.LINES, 0, 16 * this.about.cameras.length);
    gl.uniform3fv(this.uniform("flat_colour"), bold);
    gl.disable(gl.DEPTH_TEST);
    gl.drawArrays(gl.LINES, 16 * this.view, 16);
    gl.enable(gl.DEPTH_TEST);
  }
}

// hands and keys

function connectHands(canvas, shown) {
  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const [x, y] = [event.clientX - before[0], event.clientY - before[1]];
    const beside = [...fingers].find(([id]) => id !== event.pointerId);
    if (beside) {
      const apart = (p) => Math.max(1, Math.hypot(p[0] - beside[1][0], p[1] - beside[1][1]));
      shown.orbit.zoom(apart([event.clientX, event.clientY]) / apart(before));
      shown.orbit.move(x / 2 / canvas.clientHeight, y / 2 / canvas.clientHeight);
    } else if (event.shiftKey) shown.orbit.move(x / canvas.clientHeight, y / canvas.clientHeight);
    else shown.orbit.turn(x / 150, y / 150);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    shown.redraw();
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return; // the page scrolls
    event.preventDefault();
    shown.orbit.zoom(Math.exp(-event.deltaY / 300));
    shown.redraw();
  }, { passive: false });
}

function connectKeys(canvas, shown) {
  canvas.addEventListener("keydown", (event) => {
    const actions = {
      ArrowLeft: () => shown.orbit.turn(-0.15, 0), ArrowRight: () => shown.orbit.turn(0.15, 0),
      ArrowUp: () => shown.orbit.turn(0, -0.15), ArrowDown: () => shown.orbit.turn(0, 0.15),
      "+": () => shown.orbit.zoom(1.2), "=": () => shown.orbit.zoom(1.2), "-": () => shown.orbit.zoom(1 / 1.2),
      0: () => shown.orbit.reset(),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
    shown.redraw();
  });
}

function connectSurface(canvas) {
  const shown = new SurfaceView(canvas, report.surface, bytesOf("surface-data"));
  connectHands(canvas, shown);
  connectKeys(canvas, shown);
  for (const control of document.querySelectorAll("#model input")) {
    control.addEventListener("input", () => {
      const kind = document.querySelector("input[name=surface]:checked").parentElement.textContent.trim();
      canvas.setAttribute("aria-label", `The surface, showing ${kind}; arrows turn it, plus and minus zoom`);
      shown.redraw();
    });
  }
  document.getElementById("frusta").addEventListener("input", (event) => {
    if (event.target.checked) shown.orbit.include(report.surface.cameras.map((camera) => camera.centre));
  });
  document.getElementById("turn-back").addEventListener("click", () => { shown.orbit.reset(); shown.redraw(); });
  document.addEventListener("view", (event) => { shown.view = event.detail; shown.redraw(); });
  shown.redraw();
}

const canvas = document.getElementById("surface");
if (canvas) {
  try {
    connectSurface(canvas);
  } catch (error) {
    canvas.replaceWith(`The model cannot be drawn here: ${error.message}.`);
  }
}
