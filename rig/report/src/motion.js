// The report's view of the motion in space: plain WebGL, data from the section's own attribute.
(() => {
  "use strict";
  const section = document.getElementById("motion");
  const canvas = section.querySelector("canvas");
  const gl = canvas.getContext("webgl", { antialias: true, alpha: true });
  if (!gl) return;
  const PLACE_M = 1e-4, TURN_RAD = 1e-4, TIME_S = 1e-3, GAP = -32768, AROUND = 24;
  const LINK_OPACITY = 0.62, INSIDE_OPACITY = 0.65, FIELD_RAD = 0.5;

  // Vectors, quaternions x y z w, and matrices column by column.
  const add = (a, b) => a.map((x, i) => x + b[i]);
  const scaled = (a, s) => a.map((x) => x * s);
  const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => scaled(a, 1 / (Math.hypot(...a) || 1));
  const mixed = (a, b, s) => a.map((x, i) => x + s * (b[i] - x));
  const quaternion = (v) => {
    const angle = Math.hypot(...v), s = angle > 1e-9 ? Math.sin(angle / 2) / angle : 0.5;
    return [v[0] * s, v[1] * s, v[2] * s, Math.cos(angle / 2)];
  };
  const blended = (a, b, s) => unit(mixed(a, dot(a, b) < 0 ? scaled(b, -1) : b, s));
  const matrix = ([x, y, z, w], at) => [
    1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0,
    2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0,
    2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0, ...at, 1];
  const product = (a, b) => Array.from({ length: 16 }, (_, i) =>
    [0, 1, 2, 3].reduce((sum, k) => sum + a[(i % 4) + 4 * k] * b[k + 4 * (i >> 2)], 0));
  const integers = (text) => new Int16Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

  // A surface of rings, each [radius x, radius y, height, its normal's z], closed at both ends where these have no radius.
  function rings(list) {
    const vertices = [], triangles = [];
    list.forEach(([rx, ry, z, slope], ring) => {
      for (let i = 0; i <= AROUND; i++) {
        const c = Math.cos((2 * Math.PI * i) / AROUND), s = Math.sin((2 * Math.PI * i) / AROUND);
        const flat = Math.sqrt(Math.max(0, 1 - slope * slope));
        vertices.push(rx * c, ry * s, z, flat * c, flat * s, slope);
        if (ring && i) {
          const at = ring * (AROUND + 1) + i, below = at - AROUND - 1;
          triangles.push(below - 1, below, at, below - 1, at, at - 1);
        }
      }
    });
    return { vertices, triangles };
  }
  const ball = ([a, b, c]) => {
    const mesh = rings(Array.from({ length: 17 }, (_, i) => {
      const up = -Math.cos((Math.PI * i) / 16), out = Math.sin((Math.PI * i) / 16);
      return [a * out, b * out, c * up, up];
    }));
    for (let i = 0; i < mesh.vertices.length; i += 6) {
      const v = mesh.vertices, n = unit([v[i] / (a * a), v[i + 1] / (b * b), v[i + 2] / (c * c)]);
      [v[i + 3], v[i + 4], v[i + 5]] = n;
    }
    return mesh;
  };
  const shapes = {
    sphere: ([r]) => ball([r, r, r]),
    ellipsoid: ball,
    cylinder: ([r, h]) => rings([[0, 0, -h, -1], [r, r, -h, -1], [r, r, -h, 0], [r, r, h, 0], [r, r, h, 1], [0, 0, h, 1]]),
    capsule: ([r, h]) => rings(Array.from({ length: 18 }, (_, i) => {
      const angle = Math.PI * ((i < 9 ? i : i - 1) / 16 - 0.5), up = Math.sin(angle), out = Math.cos(angle);
      return [r * out, r * out, r * up + (i < 9 ? -h : h), up];
    })),
    box: ([a, b, c]) => {
      const vertices = [], triangles = [];
      for (const axis of [0, 1, 2]) for (const side of [-1, 1]) {
        const first = vertices.length / 6;
        for (const [u, v] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
          const corner = [0, 0, 0], normal = [0, 0, 0];
          [corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3]] = [side, u * side, v];
          normal[axis] = side;
          vertices.push(corner[0] * a, corner[1] * b, corner[2] * c, ...normal);
        }
        triangles.push(first, first + 1, first + 2, first, first + 2, first + 3);
      }
      return { vertices, triangles };
    },
  };

  // What the graphics processor is told.
  const shader = (kind, text) => {
    const made = gl.createShader(kind);
    gl.shaderSource(made, text);
    gl.compileShader(made);
    return made;
  };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, `
    attribute vec3 at; attribute vec3 normal; uniform mat4 model, view; varying vec3 facing;
    void main() { facing = (model * vec4(normal, 0.0)).xyz; gl_Position = view * model * vec4(at, 1.0); }`));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, `
    precision mediump float; uniform vec4 paint; uniform vec3 light; uniform float lit; varying vec3 facing;
    void main() {
      float shine = mix(1.0, 0.55 + 0.5 * max(0.0, dot(normalize(facing), light)), lit);
      gl_FragColor = vec4(paint.rgb * shine, 1.0) * paint.a;
    }`));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return;
  gl.useProgram(program);
  const place = Object.fromEntries(["model", "view", "paint", "light", "lit"].map((name) => [name, gl.getUniformLocation(program, name)]));
  const inputs = ["at", "normal"].map((name) => gl.getAttribLocation(program, name));
  inputs.forEach((input) => gl.enableVertexAttribArray(input));
  const buffer = (target, data) => {
    const made = gl.createBuffer();
    gl.bindBuffer(target, made);
    gl.bufferData(target, data, gl.STATIC_DRAW);
    return made;
  };
  const uploaded = ({ vertices, triangles }) => ({
    vertices: buffer(gl.ARRAY_BUFFER, new Float32Array(vertices)),
    triangles: buffer(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array(triangles)),
    count: triangles.length,
  });
  const bind = (vertices) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, vertices);
    inputs.forEach((input, i) => gl.vertexAttribPointer(input, 3, gl.FLOAT, false, 24, 12 * i));
  };
  const dot1 = uploaded(ball([1, 1, 1]));
  const strokes = gl.createBuffer();

  // Meshes of 1, 2 or 5 times a power of ten, five to twelve across.
  const netStep = (reach) => {
    const ten = 10 ** Math.floor(Math.log10(reach));
    return reach / ten > 5 ? ten : reach / ten > 2 ? ten / 2 : ten / 5;
  };

  // One run: its numbers, and what is where at a time.
  function unpacked(run) {
    const poses = integers(run.poses), measured = integers(run.measured), times = run.times.map((t) => t * TIME_S);
    const parts = run.shapes.map((shape) => ({ ...shape, mesh: uploaded(shapes[shape.kind](shape.size)), local: matrix(shape.turn, shape.at) }));
    const pose = (frame, body) => {
      const from = 6 * (frame * run.bodies + body);
      return { at: scaled([...poses.slice(from, from + 3)], PLACE_M), turn: quaternion(scaled([...poses.slice(from + 3, from + 6)], TURN_RAD)) };
    };
    const between = (time) => {
      let frame = times.findIndex((t) => t > time) - 1;
      if (frame === -2) frame = times.length - 1;
      frame = Math.max(0, frame);
      const next = Math.min(frame + 1, times.length - 1);
      return { frame, next, share: next > frame ? Math.min(1, Math.max(0, (time - times[frame]) / (times[next] - times[frame]))) : 0 };
    };
    const at = (time) => {
      const { frame, next, share } = between(time);
      const bodies = Array.from({ length: run.bodies }, (_, body) => {
        const [a, b] = [pose(frame, body), pose(next, body)];
        return matrix(blended(a.turn, b.turn, share), mixed(a.at, b.at, share));
      });
      const points = run.keypoints.map((_, k) => {
        const seen = [frame, next].map((f) => [...measured.slice(3 * (f * run.keypoints.length + k), 3 * (f * run.keypoints.length + k) + 3)]);
        const gap = seen.map((p) => p.includes(GAP));
        if (gap[0] && gap[1]) return null;
        return scaled(gap[0] ? seen[1] : gap[1] ? seen[0] : mixed(seen[0], seen[1], share), PLACE_M);
      });
      return { bodies, points };
    };
    // Where everything has its room: the middle, and how far it reaches.
    const taken = [], low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (let i = 0; i < times.length; i += Math.max(1, Math.floor(times.length / 60))) {
      const { bodies } = at(times[i]);
      for (const part of parts.filter((part) => part.body || run.bodies === 1)) {
        const at = product(bodies[part.body], part.local).slice(12, 15), size = part.kind === "capsule" ? part.size[0] + part.size[1] : Math.max(...part.size);
        taken.push({ at, size });
        at.forEach((x, axis) => { low[axis] = Math.min(low[axis], x - size); high[axis] = Math.max(high[axis], x + size); });
      }
    }
    const middle = low.map((x, axis) => (x + high[axis]) / 2);
    const reach = taken.reduce((most, { at, size }) => Math.max(most, size + Math.hypot(...at.map((x, axis) => x - middle[axis]))), 0) || 0.1;
    return { run, times, parts, at, middle, reach };
  }

  const runs = JSON.parse(section.dataset.motion).map((run) => ({ run, known: null }));
  const find = (name) => section.querySelector(name);
  const slider = find("input"), output = find("output"), speed = find(".speed"), play = find(".play"), chosen = find(".run");
  const front = { yaw: 0, pitch: 0, zoom: 1 }, usual = { yaw: 0.55, pitch: 0.3, zoom: 1 };
  let shown, time = 0, playing = false, last = 0, waiting = false, look = { ...usual };

  const paint = (name, opacity) => {
    const probe = document.createElement("canvas").getContext("2d");
    probe.fillStyle = getComputedStyle(section).getPropertyValue(name).trim() || "#888";
    const hex = parseInt(probe.fillStyle.slice(1), 16);
    return [(hex >> 16) / 255, ((hex >> 8) & 255) / 255, (hex & 255) / 255, opacity];
  };

  function draw() {
    waiting = false;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * ratio)));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);

    // The picture's axes in the world, turned by the reader.
    const axes = shown.run.axes.map((axis) => [0, 1, 2].map((i) => Number(i === axis)));
    const [right0, up0, near0] = [axes[0], axes[1], cross(axes[0], axes[1])];
    const mix = (x, y, z) => add(add(scaled(right0, x), scaled(up0, y)), scaled(near0, z));
    const { yaw, pitch, zoom } = look;
    const back = mix(-Math.sin(yaw) * Math.cos(pitch), Math.sin(pitch), Math.cos(yaw) * Math.cos(pitch));
    const right = mix(Math.cos(yaw), 0, Math.sin(yaw)), up = cross(back, right);
    const far = shown.reach / Math.sin(FIELD_RAD / 2) / zoom / Math.min(1, width / height);
    const eye = add(shown.middle, scaled(back, far));
    const f = 1 / Math.tan(FIELD_RAD / 2), nearest = Math.max(far - 3 * shown.reach, far / 100), farthest = far + 3 * shown.reach;
    const seen = product(
      [(f * height) / width, 0, 0, 0, 0, f, 0, 0, 0, 0, (nearest + farthest) / (nearest - farthest), -1, 0, 0, (2 * nearest * farthest) / (nearest - farthest), 0],
      [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, -dot(right, eye), -dot(up, eye), -dot(back, eye), 1]);
    gl.uniformMatrix4fv(place.view, false, seen);
    gl.uniform3fv(place.light, unit(add(add(back, scaled(up, 0.7)), scaled(right, 0.4))));

    const mesh = (mesh, model, colour) => {
      bind(mesh.vertices);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.triangles);
      gl.uniformMatrix4fv(place.model, false, model);
      gl.uniform4fv(place.paint, colour);
      gl.uniform1f(place.lit, 1);
      gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_SHORT, 0);
    };
    const lines = (points, colour) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, strokes);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points.flatMap((p) => [...p, 0, 0, 1])), gl.DYNAMIC_DRAW);
      bind(strokes);
      gl.uniformMatrix4fv(place.model, false, matrix([0, 0, 0, 1], [0, 0, 0]));
      gl.uniform4fv(place.paint, colour);
      gl.uniform1f(place.lit, 0);
      gl.drawArrays(gl.LINES, 0, points.length);
    };

    // A square net in the plane of motion.
    const step = netStep(shown.reach), count = Math.ceil(shown.reach / step), net = [];
    const corner = axes.map((axis) => Math.round(dot(shown.middle, axis) / step) * step);
    for (let i = -count; i <= count; i++) {
      const at = (a, b) => mix(corner[0] + a * step, corner[1] + b * step, 0);
      net.push(at(i, -count), at(i, count), at(-count, i), at(count, i));
    }
    lines(net, paint("--grid", 1));

    const { bodies, points } = shown.at(time), red = paint("--simulated", LINK_OPACITY), radius = 0.02 * shown.reach;
    const measured = (opacity) => {
      const blue = paint("--measured", opacity);
      points.forEach((p) => p && mesh(dot1, [radius, 0, 0, 0, 0, radius, 0, 0, 0, 0, radius, 0, ...p, 1], blue));
      lines(shown.run.joined.filter(([a, b]) => points[a] && points[b]).flatMap(([a, b]) => [points[a], points[b]]), blue);
    };
    // Before the links and, faintly, over them: keypoints lie inside.
    measured(1);
    for (const part of shown.parts) {
      mesh(part.mesh, product(bodies[part.body], part.local), part.body ? red : paint("--band", LINK_OPACITY));
    }
    gl.disable(gl.DEPTH_TEST);
    measured(INSIDE_OPACITY);
    slider.value = String(Math.round(time / TIME_S));
    output.textContent = `${time.toFixed(2)} s`;
    slider.setAttribute("aria-valuetext", output.textContent);
  }
  const later = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };

  function run(now) {
    if (!playing) return;
    const end = shown.times[shown.times.length - 1];
    time += Math.min(0.5, (now - last) / 1000) * Number(speed.value);
    if (time > end) time = shown.times[0];
    last = now;
    later();
    requestAnimationFrame(run);
  }
  function playOrPause(wanted) {
    playing = wanted;
    play.textContent = playing ? "pause" : "play";
    last = performance.now();
    if (playing) requestAnimationFrame(run);
  }
  function choose(index) {
    const entry = runs[index];
    entry.known = entry.known || unpacked(entry.run);
    shown = entry.known;
    slider.min = String(Math.floor(shown.times[0] / TIME_S));
    slider.max = String(Math.ceil(shown.times[shown.times.length - 1] / TIME_S));
    time = Math.max(shown.times[0], entry.run.start * TIME_S);
    find(".net").textContent = `${+(1e3 * netStep(shown.reach)).toPrecision(1)} mm`;
    later();
  }
  // #t=1.2, with &view=front as the camera sees it.
  function follow() {
    const asked = new URLSearchParams(location.hash.slice(1)), t = parseFloat(asked.get("t"));
    if (asked.get("view") === "front") look = { ...front };
    if (t >= 0) time = t;
    later();
  }
  const turn = (yaw, pitch) => {
    look.yaw += yaw;
    look.pitch = Math.max(-1.5, Math.min(1.5, look.pitch + pitch));
    later();
  };
  const zoom = (factor) => { look.zoom = Math.max(0.3, Math.min(12, look.zoom * factor)); later(); };

  play.onclick = () => playOrPause(!playing);
  slider.oninput = () => { playOrPause(false); time = slider.valueAsNumber * TIME_S; later(); };
  find(".front").onclick = () => { look = { ...front }; later(); };
  find(".reset").onclick = () => { look = { ...usual }; later(); };
  if (chosen) chosen.onchange = () => choose(chosen.selectedIndex);
  const keys = {
    ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1),
    "+": () => zoom(1.15), "=": () => zoom(1.15), "-": () => zoom(1 / 1.15), " ": () => playOrPause(!playing), 0: () => find(".reset").click(),
  };
  canvas.onkeydown = (event) => {
    const does = keys[event.key];
    if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    does();
  };
  // Only where the reader has clicked: a page that is scrolled past stays a page.
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas) return;
    event.preventDefault();
    zoom(Math.exp(-0.0015 * event.deltaY));
  }, { passive: false });
  const fingers = new Map();
  const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
  canvas.onpointerdown = (event) => { canvas.setPointerCapture(event.pointerId); fingers.set(event.pointerId, { x: event.clientX, y: event.clientY }); };
  canvas.onpointerup = canvas.onpointercancel = (event) => fingers.delete(event.pointerId);
  canvas.onpointermove = (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const apart = fingers.size === 2 ? spread() : 0, share = 1 / fingers.size;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    turn(0.008 * share * (event.clientX - before.x), 0.008 * share * (event.clientY - before.y));
    if (apart) zoom(spread() / apart);
  };
  canvas.addEventListener("webglcontextlost", (event) => { event.preventDefault(); playOrPause(false); });
  canvas.addEventListener("webglcontextrestored", () => location.reload());

  find(".fallback").hidden = true;
  find(".view").hidden = false;
  choose(0);
  follow();
  window.addEventListener("hashchange", follow);
  new ResizeObserver(later).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", later);
})();
