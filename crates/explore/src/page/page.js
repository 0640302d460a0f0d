"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const byId = (id) => document.getElementById(id);
  const all = data.numbers.length;
  const state = { z: new Array(all).fill(0), count: all, grasp: 0, degrees: true, frame: null };

  // The numbers, and what they decode to.

  const affine = (map, z) => map.mean.map((mean, j) => {
    const value = z.reduce((sum, number, i) => sum + number * map.matrix[i][j], mean);
    return Math.min(Math.max(value, map.lower[j] ?? -Infinity), map.upper[j] ?? Infinity);
  });
  const numbers = () => state.z.map((number, i) => (i < state.count ? number : 0));
  // In a recorded episode, the joints are where they were measured.
  const joints = () => (state.frame ? state.frame.q : affine(data.joints, numbers()));
  const commands = () => (data.commands ? affine(data.commands, numbers()) : []);
  // The second synergy: its sliders stand where those of the first do, as shares of their ranges.
  const other = data.beside && { ...data.beside, z: new Array(data.beside.numbers.length).fill(0) };
  const otherJoints = () => {
    const q = affine(other.joints, other.z.map((number, i) => (i < state.count ? number : 0)));
    return data.joints.names.map((name) => q[other.joints.names.indexOf(name)]);
  };
  const follow = (i) => {
    if (!other || i >= other.z.length) return;
    const [from, to] = [data.numbers[i], other.numbers[i]];
    const [bound, target] = state.z[i] < 0 ? [from.least, to.least] : [from.greatest, to.greatest];
    other.z[i] = bound ? (state.z[i] / bound) * target : 0;
  };
  const named = (map, values) => Object.fromEntries(map.names.map((name, j) => [name, values[j]]));

  // Where the parts are: a part moves with its parent, then by each of its joints. A motion is a rotation matrix, row by row,
  // and a shift.

  const identity = { r: [1, 0, 0, 0, 1, 0, 0, 0, 1], t: [0, 0, 0] };
  const turn = (r, p) => [0, 3, 6].map((row) => r[row] * p[0] + r[row + 1] * p[1] + r[row + 2] * p[2]);
  const place = (motion, p) => turn(motion.r, p).map((x, axis) => x + motion.t[axis]);
  const after = (a, b) => {
    const column = (j) => turn(a.r, [b.r[j], b.r[3 + j], b.r[6 + j]]);
    const [x, y, z] = [column(0), column(1), column(2)];
    return { r: [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]], t: place(a, b.t) };
  };
  const about = (axis, anchor, angle) => {
    const [x, y, z] = axis;
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    const v = 1 - c;
    const r = [
      c + x * x * v, x * y * v - z * s, x * z * v + y * s,
      y * x * v + z * s, c + y * y * v, y * z * v - x * s,
      z * x * v - y * s, z * y * v + x * s, c + z * z * v,
    ];
    return { r, t: turn(r, anchor).map((moved, i) => anchor[i] - moved) };
  };
  const motions = (q) => {
    const found = [];
    for (const part of data.parts) {
      let motion = part.parent === null ? identity : found[part.parent];
      for (const joint of part.joints) {
        const change = q[joint.joint] - joint.reference;
        const own = joint.slides
          ? { r: identity.r, t: joint.axis.map((x) => x * change) }
          : about(joint.axis, joint.anchor, change);
        motion = after(motion, own);
      }
      found.push(motion);
    }
    return found;
  };
  const tips = () => {
    const found = motions(joints());
    return Object.fromEntries(data.tips.map((tip) => [tip.name, place(found[tip.part], tip.at)]));
  };

  // The surfaces.

  const unpack = (surface) => {
    const text = atob(surface.corners);
    const corners = new Float32Array(text.length / 2);
    for (let i = 0; i < corners.length; i += 1) {
      const steps = text.charCodeAt(2 * i) + 256 * text.charCodeAt(2 * i + 1);
      corners[i] = surface.low[i % 3] + steps * surface.step[i % 3];
    }
    return corners;
  };
  const normals = (corners) => {
    const found = new Float32Array(corners.length);
    for (let i = 0; i < corners.length; i += 9) {
      const edge = (to) => [0, 1, 2].map((axis) => corners[i + to + axis] - corners[i + axis]);
      const [a, b] = [edge(3), edge(6)];
      const n = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
      const length = Math.hypot(...n) || 1;
      for (let j = 0; j < 9; j += 1) found[i + j] = n[j % 3] / length;
    }
    return found;
  };

  const VERTEX = `
    attribute vec3 corner, normal;
    uniform mat4 motion, view;
    varying vec3 direction;
    void main() {
      direction = mat3(motion) * normal;
      gl_Position = view * motion * vec4(corner, 1.0);
    }`;
  const FRAGMENT = `
    precision mediump float;
    varying vec3 direction;
    uniform vec3 colour, eye;
    void main() {
      vec3 n = normalize(direction);
      if (dot(n, eye) < 0.0) n = -n;
      float key = max(dot(n, normalize(eye + vec3(0.0, 0.0, 0.9))), 0.0);
      float fill = 0.5 + 0.5 * n.z;
      float table = max(-n.z, 0.0);
      gl_FragColor = vec4(colour * (0.36 + 0.6 * key + 0.2 * fill + 0.25 * table), 1.0);
    }`;

  const canvas = byId("view");
  const gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
  let scene = null;
  try {
    if (!gl) throw new Error("this browser has no WebGL");
    scene = prepare(gl);
  } catch (error) {
    byId("failure").hidden = false;
    byId("failure").textContent = `The hand is not drawn: ${error.message}. The numbers work.`;
  }

  function prepare(gl) {
    const shader = (kind, source) => {
      const made = gl.createShader(kind);
      gl.shaderSource(made, source);
      gl.compileShader(made);
      if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(made));
      return made;
    };
    const program = gl.createProgram();
    gl.attachShader(program, shader(gl.VERTEX_SHADER, VERTEX));
    gl.attachShader(program, shader(gl.FRAGMENT_SHADER, FRAGMENT));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    const buffer = (values) => {
      const made = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, made);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      return made;
    };
    const load = (surface) => {
      const corners = unpack(surface);
      return { ...surface, n: corners.length / 3, corner: buffer(corners), normal: buffer(normals(corners)) };
    };
    const surfaces = data.surfaces.map(load);
    const objects = data.recordings.map((recording) => load(recording.surface));
    const uniform = Object.fromEntries(
      ["motion", "view", "colour", "eye"].map((name) => [name, gl.getUniformLocation(program, name)]));
    const attribute = Object.fromEntries(["corner", "normal"].map((name) => [name, gl.getAttribLocation(program, name)]));
    return { surfaces, objects, uniform, attribute };
  }

  // The camera looks at the middle of palm and fingers; a forearm may leave the view.

  const reach = (() => {
    let [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    const add = (p) => {
      low = low.map((x, axis) => Math.min(x, p[axis]));
      high = high.map((x, axis) => Math.max(x, p[axis]));
    };
    const below = [];
    data.parts.forEach((part, i) => below.push(i === data.palm || (part.parent !== null && below[part.parent])));
    for (const surface of data.surfaces.filter((one) => below[one.part])) {
      add(surface.low);
      add(surface.low.map((x, axis) => x + 65535 * surface.step[axis]));
    }
    data.tips.forEach((tip) => add(tip.at));
    const middle = low.map((x, axis) => (x + high[axis]) / 2);
    return { middle, radius: Math.hypot(...high.map((x, axis) => x - low[axis])) / 2 };
  })();
  const START = { azimuth: 0.6, elevation: -0.45, zoom: 1 };
  const camera = { ...START };

  function draw() {
    if (!scene) return;
    const scale = window.devicePixelRatio || 1;
    const [width, height] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
    if (width === 0 || height === 0) return;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const [ca, sa] = [Math.cos(camera.azimuth), Math.sin(camera.azimuth)];
    const [ce, se] = [Math.cos(camera.elevation), Math.sin(camera.elevation)];
    const eye = [ce * ca, ce * sa, se];
    const right = [-sa, ca, 0];
    const up = [-se * ca, -se * sa, ce];
    const half = 0.3;
    // Two hands need twice the width.
    const wide = other ? 2 : 1;
    const distance = (reach.radius * camera.zoom * 1.05) / Math.sin(half) / Math.min(1, width / height / wide);
    const at = reach.middle.map((x, axis) => x + eye[axis] * distance);
    const f = 1 / Math.tan(half);
    const [near, far] = [distance / 50, distance * 4];
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const row = (axis, factor) => [...axis.map((x) => x * factor), -dot(axis, at) * factor];
    const depth = row(eye, 1);
    const rows = [
      row(right, (f * height) / width),
      row(up, f),
      depth.map((x, i) => ((far + near) / (near - far)) * x + (i === 3 ? (2 * far * near) / (near - far) : 0)),
      depth.map((x) => -x),
    ];
    const columns = new Float32Array(16).map((_, i) => rows[i % 4][Math.floor(i / 4)]);
    gl.viewport(0, 0, width, height);
    const paper = getComputedStyle(canvas.parentElement).backgroundColor.match(/[\d.]+/g).slice(0, 3);
    gl.clearColor(...paper.map((x) => x / 255), 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(scene.uniform.view, false, columns);
    gl.uniform3fv(scene.uniform.eye, eye);
    const aside = (side) => right.map((x) => x * side * reach.radius * 1.05);
    const hands = other ? [[joints(), aside(-1)], [otherJoints(), aside(1)]] : [[joints(), [0, 0, 0]]];
    for (const [q, shift] of hands) {
      paint(scene.surfaces, motions(q), shift);
      if (state.frame) paint([{ ...scene.objects[state.frame.recording], part: 0 }], [state.frame], shift);
    }
  }

  function paint(surfaces, found, shift) {
    for (const surface of surfaces) {
      const { r } = found[surface.part];
      const t = found[surface.part].t.map((x, axis) => x + shift[axis]);
      gl.uniformMatrix4fv(scene.uniform.motion, false,
        [r[0], r[3], r[6], 0, r[1], r[4], r[7], 0, r[2], r[5], r[8], 0, t[0], t[1], t[2], 1]);
      gl.uniform3fv(scene.uniform.colour, surface.colour);
      for (const name of ["corner", "normal"]) {
        gl.bindBuffer(gl.ARRAY_BUFFER, surface[name]);
        gl.enableVertexAttribArray(scene.attribute[name]);
        gl.vertexAttribPointer(scene.attribute[name], 3, gl.FLOAT, false, 0, 0);
      }
      gl.drawArrays(gl.TRIANGLES, 0, surface.n);
    }
  }

  // The controls.

  const percent = (share) => `${(100 * share).toFixed(1)} %`;
  const sliders = data.numbers.map((number, i) => {
    const box = document.createElement("div");
    box.className = "number";
    const label = document.createElement("label");
    label.htmlFor = `z${i + 1}`;
    const words = document.createElement("span");
    words.append(`z${i + 1} `);
    const what = document.createElement("span");
    what.className = "words";
    what.textContent = `${number.words} (${percent(number.share)})`;
    words.append(what);
    const output = document.createElement("span");
    output.className = "value";
    label.append(words, output);
    const input = document.createElement("input");
    Object.assign(input, { type: "range", id: `z${i + 1}`, min: number.least, max: number.greatest, step: "any", value: 0 });
    input.addEventListener("input", () => {
      stop();
      state.z[i] = Number(input.value);
      state.z.forEach((_, j) => follow(j));
      update();
    });
    box.append(label, input);
    byId("sliders").append(box);
    return { box, input, output };
  });
  for (let k = 1; k <= all; k += 1) {
    const option = document.createElement("option");
    option.value = k;
    option.textContent = k === data.recommended ? `${k} (recommended)` : `${k}`;
    byId("count").append(option);
  }
  byId("count").value = all;
  byId("count").addEventListener("change", () => {
    stop();
    state.count = Number(byId("count").value);
    state.grasp = 0;
    update();
  });

  const table = (id, map) => {
    const body = byId(id).tBodies[0];
    return map.names.map((name) => {
      const row = body.insertRow();
      row.insertCell().textContent = name;
      return { row, cell: row.insertCell() };
    });
  };
  const rows = { joints: table("joints", data.joints), commands: data.commands ? table("commands", data.commands) : [] };
  byId("commands").hidden = byId("copy-commands").hidden = !data.commands;
  const write = (map, values, cells) => cells.forEach(({ row, cell }, j) => {
    const angle = map.units[j] === "rad";
    const shown = angle && state.degrees ? `${((values[j] * 180) / Math.PI).toFixed(1)}°`
      : angle ? values[j].toFixed(3) : `${(1000 * values[j]).toFixed(1)} mm`;
    const clamped = values[j] === map.lower[j] || values[j] === map.upper[j];
    cell.textContent = clamped ? `${shown} (limit)` : shown;
    cell.dataset.value = values[j];
    row.className = clamped ? "clamped" : "";
  });

  function update() {
    sliders.forEach(({ box, input, output }, i) => {
      box.hidden = i >= state.count;
      input.value = state.z[i];
      output.textContent = state.z[i].toFixed(2);
      input.setAttribute("aria-valuetext", output.textContent);
    });
    const share = data.numbers.slice(0, state.count).reduce((sum, number) => sum + number.share, 0);
    byId("expressed").textContent = `express ${percent(share)} of the variance`;
    write(data.joints, joints(), rows.joints);
    if (data.commands) write(data.commands, commands(), rows.commands);
    const grasp = grasps()[state.grasp];
    for (const id of ["open", "close", "play", "next"]) byId(id).disabled = !grasp;
    byId("grasp").textContent = grasp && !state.frame ? `${grasp.object}, mean of ${grasp.motions}` : "";
    draw();
  }

  // Grasps with the chosen count of numbers, or else the first of those with more.
  const grasps = () => {
    const exact = data.grasps.filter((grasp) => grasp.numbers === state.count);
    return exact.length ? exact : data.grasps.filter((grasp) => grasp.numbers > state.count);
  };
  const moment = (grasp, name) => state.z.map((_, i) => grasp[name].z[i] ?? 0);
  // The grasp of the same object with the other synergy.
  const twin = (grasp) => other && other.grasps.find((one) => one.object === grasp.object && one.numbers >= Math.min(state.count, other.z.length));
  let running = 0;
  function stop() {
    running += 1;
    state.frame = null;
    byId("replayed").textContent = "";
  }
  async function go(names) {
    stop();
    const mine = running;
    const grasp = grasps()[state.grasp];
    if (!grasp) return;
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    for (const name of names) {
      const [from, to] = [[...state.z], moment(grasp, name)];
      const second = twin(grasp);
      const [otherFrom, otherTo] = second ? [[...other.z], other.z.map((_, i) => second[name].z[i] ?? 0)] : [[], []];
      const [start, span] = [performance.now(), still ? 0 : 700];
      for (let share = 0; share < 1;) {
        share = span === 0 ? 1 : Math.min(1, (performance.now() - start) / span);
        const eased = share * share * (3 - 2 * share);
        state.z = from.map((x, i) => x + eased * (to[i] - x));
        if (second) other.z = otherFrom.map((x, i) => x + eased * (otherTo[i] - x));
        else if (other) state.z.forEach((_, i) => follow(i));
        update();
        if (share < 1) await new Promise(requestAnimationFrame);
        if (mine !== running) return;
      }
    }
  }
  byId("open").addEventListener("click", () => go(["open"]));
  byId("close").addEventListener("click", () => go(["closed", "held"]));
  byId("play").addEventListener("click", () => go(["open", "closed", "held"]));
  byId("next").addEventListener("click", () => {
    state.grasp = (state.grasp + 1) % Math.max(1, grasps().length);
    go(["open", "closed", "held"]);
  });
  // A recorded episode shows the hand as it was measured, with its object; the sliders show the numbers of the commands. A
  // second hand has the numbers of the second synergy that are nearest to the same commands.
  const show = (recording, step) => {
    const { object, success, period, frames } = data.recordings[recording];
    const frame = frames[step];
    state.frame = { ...frame, recording };
    state.z = state.z.map((_, i) => frame.z[i] ?? 0);
    if (other) other.z = other.z.map((_, i) => frame.beside[i] ?? 0);
    const outcome = step + 1 === frames.length ? (success ? ", success" : ", failure") : "";
    const hands = other ? "left as measured, right as the second synergy has it" : "joints as measured, nearest numbers";
    byId("replayed").textContent = `${object}, ${(period * step).toFixed(1)} s${outcome}: ${hands}`;
    update();
  };
  byId("recordings").hidden = data.recordings.length === 0;
  data.recordings.forEach((recording, i) => byId("recording").add(new Option(recording.object, i)));
  byId("replay").addEventListener("click", async () => {
    stop();
    const mine = running;
    const recording = Number(byId("recording").value);
    const { frames, period } = data.recordings[recording];
    const start = performance.now();
    for (let step = 0; step + 1 < frames.length;) {
      step = Math.min(frames.length - 1, Math.floor((performance.now() - start) / 1000 / period));
      show(recording, step);
      await new Promise(requestAnimationFrame);
      if (mine !== running) return;
    }
  });
  if (other) {
    byId("sides").hidden = false;
    for (const title of [data.title, other.title]) {
      const side = document.createElement("span");
      side.textContent = title;
      byId("sides").append(side);
    }
  }
  byId("mean").addEventListener("click", () => {
    stop();
    state.z = state.z.map(() => 0);
    if (other) other.z = other.z.map(() => 0);
    update();
  });
  for (const id of ["open", "close", "play", "next"]) byId(id).hidden = data.grasps.length === 0;
  byId("unit").addEventListener("change", () => {
    state.degrees = byId("unit").value === "deg";
    update();
  });
  const copy = async (what, values) => {
    const text = JSON.stringify(values, null, 2);
    try {
      await navigator.clipboard.writeText(text);
      byId("copied").textContent = `${what} copied, in rad and m`;
    } catch {
      window.prompt(`Copy the ${what}`, text);
    }
  };
  byId("copy-joints").addEventListener("click", () => copy("joints", named(data.joints, joints())));
  byId("copy-commands").addEventListener("click", () => copy("commands", named(data.commands, commands())));

  // Turning and zooming.

  const bound = (x, low, high) => Math.min(Math.max(x, low), high);
  const look = (azimuth, elevation, zoom) => {
    camera.azimuth += azimuth;
    camera.elevation = bound(camera.elevation + elevation, -1.5, 1.5);
    camera.zoom = bound(camera.zoom * zoom, 0.2, 5);
    draw();
  };
  const held = new Map();
  const spread = () => {
    const [a, b] = [...held.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const apart = held.size === 2 ? spread() : 0;
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (held.size === 2) look(0, 0, apart / Math.max(1, spread()));
    else look((before.x - event.clientX) * 0.008, (event.clientY - before.y) * 0.008, 1);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => held.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    look(0, 0, Math.exp(event.deltaY * 0.001));
  }, { passive: false });
  const reset = () => {
    Object.assign(camera, START);
    draw();
  };
  canvas.addEventListener("dblclick", reset);
  const keys = {
    ArrowLeft: [0.1, 0, 1], ArrowRight: [-0.1, 0, 1], ArrowUp: [0, -0.1, 1], ArrowDown: [0, 0.1, 1],
    "+": [0, 0, 0.9], "-": [0, 0, 1.1],
  };
  canvas.addEventListener("keydown", (event) => {
    if (event.key === "0") reset();
    if (!keys[event.key]) return;
    event.preventDefault();
    look(...keys[event.key]);
  });
  new ResizeObserver(draw).observe(canvas);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);

  // For programs: the state in full precision.
  window.eigenhand = {
    set: (z) => {
      stop();
      state.z = state.z.map((_, i) => z[i] ?? 0);
      state.z.forEach((_, i) => follow(i));
      update();
    },
    show,
    // Where the hand's fingertips and the object's first corner are in the frame that is shown.
    shown: () => {
      const corner = unpack(data.recordings[state.frame.recording].surface).slice(0, 3);
      return {
        tips: tips(),
        corner: place(state.frame, [...corner]),
      };
    },
    other: () => (other ? named(data.joints, otherJoints()) : null),
    joints: () => named(data.joints, joints()),
    commands: () => (data.commands ? named(data.commands, commands()) : null),
    tips,
  };
  update();
})();
