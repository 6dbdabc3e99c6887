(() => {
  const data = JSON.parse(document.getElementById("scene-data").textContent);
  const canvas = document.getElementById("scene-canvas");
  const slider = document.getElementById("scene-time");
  const label = document.getElementById("scene-label");
  const button = document.getElementById("scene-play");
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const end = data.times[data.times.length - 1];
  let yaw = -0.9, pitch = 0.5, zoom = 1, time = 0, playing = false, last = 0;
  slider.max = end;

  const turn = (r, p) => r.map((row) => row[0] * p[0] + row[1] * p[1] + row[2] * p[2]);
  const add = (p, q) => p.map((x, k) => x + q[k]);
  const matrix = ([w, x, y, z]) => [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
  const upright = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  const centre = [0, 1, 2].map((k) => data.positions.reduce((sum, p) => sum + p[k], 0) / data.positions.length);
  const far = (points) => Math.max(0.1, ...points.map((p) => Math.hypot(...p)));
  const size = far(data.robots.map((robot) => robot.position)) + far(data.positions.map((p) => p.map((x, k) => x - centre[k])));
  const axes = [[0.12, 0, 0], [0, 0.12, 0], [0, 0, 0.12]].map((axis) => axis.map((x) => x * Math.min(1, size)));
  const corners = [];
  for (const x of [-0.5, 0.5]) for (const y of [-0.5, 0.5]) for (const z of [-0.5, 0.5]) corners.push([x, y, z]);
  const faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];

  const latest = (list, at) => {
    let found = list[0];
    for (const each of list) if (each[0] <= at + 1e-9) found = each;
    return found;
  };
  const colourOf = (name) => {
    const state = (latest(data.states[name], time) || [0, ""])[1];
    return state === "stale" ? style("--bad") : state === "converged" ? style("--good") : style("--muted");
  };

  const draw = () => {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const scale = (0.6 * Math.min(width, height) * zoom) / size;
    let k = 0;
    while (k + 1 < data.times.length && data.times[k + 1] <= time + 1e-9) k += 1;
    const rotation = matrix(data.quaternions[k]), position = data.positions[k];
    const world = (p) => add(turn(rotation, p), position);
    const seen = (p) => {
      const [x, y, z] = p.map((each, axis) => each - centre[axis]);
      const across = Math.cos(yaw) * x - Math.sin(yaw) * y, along = Math.sin(yaw) * x + Math.cos(yaw) * y;
      return [
        width / 2 + scale * across,
        height / 2 - scale * (Math.cos(pitch) * z + Math.sin(pitch) * along),
        Math.cos(pitch) * along - Math.sin(pitch) * z,
      ];
    };
    const line = (from, to, colour, thick, dashes = []) => {
      pen.strokeStyle = colour;
      pen.lineWidth = thick;
      pen.setLineDash(dashes);
      pen.beginPath();
      pen.moveTo(from[0], from[1]);
      pen.lineTo(to[0], to[1]);
      pen.stroke();
      pen.setLineDash([]);
    };
    const polygons = [];
    const box = (shape, turned, colour) => {
      const points = corners.map((c) => seen(world(add(turn(turned, c.map((x, a) => x * shape.size[a])), shape.position))));
      for (const face of faces) {
        const outline = face.map((corner) => points[corner]);
        polygons.push({ outline, colour, depth: outline.reduce((sum, p) => sum + p[2], 0) });
      }
    };
    for (const shape of data.boxes) box(shape, shape.rotation, style("--accent"));
    for (const load of latest(data.loads, time)[1]) box(load, upright, style("--bad"));
    polygons.sort((a, b) => b.depth - a.depth);
    for (const { outline, colour } of polygons) {
      pen.beginPath();
      outline.forEach((p, each) => (each ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])));
      pen.closePath();
      pen.globalAlpha = 0.16;
      pen.fillStyle = colour;
      pen.fill();
      pen.globalAlpha = 0.8;
      pen.strokeStyle = colour;
      pen.lineWidth = 0.8;
      pen.stroke();
      pen.globalAlpha = 1;
    }
    const places = Object.fromEntries(data.robots.map((robot) => [robot.name, seen(world(robot.position))]));
    if (!data.boxes.length) for (const name in places) line(seen(position), places[name], style("--accent"), 1);
    for (const [one, other] of data.links) line(places[one], places[other], style("--muted"), 1, [4, 4]);
    pen.font = "13px system-ui, sans-serif";
    for (const robot of data.robots) {
      const [x, y] = places[robot.name];
      axes.forEach((axis, each) => {
        const tip = seen(world(add(turn(robot.rotation, axis), robot.position)));
        line([x, y], tip, ["#d1373f", "#2f9e54", "#3b6fd4"][each], 2);
      });
      pen.fillStyle = colourOf(robot.name);
      pen.beginPath();
      pen.arc(x, y, 5, 0, 2 * Math.PI);
      pen.fill();
      pen.fillText(robot.name, x + 8, y - 8);
    }
    slider.value = time;
    label.textContent = `${time.toFixed(1)} s of ${end.toFixed(1)} s`;
    canvas.dataset.time = time.toFixed(2);
  };

  const step = (now) => {
    if (!playing) return;
    time = Math.min(end, time + Math.min(0.1, (now - last) / 1000));
    last = now;
    if (time >= end) stop();
    draw();
    requestAnimationFrame(step);
  };
  const stop = () => {
    playing = false;
    button.textContent = "Play";
  };
  button.addEventListener("click", () => {
    if (playing) return stop();
    if (time >= end) time = 0;
    playing = true;
    button.textContent = "Pause";
    last = performance.now();
    requestAnimationFrame(step);
  });
  slider.addEventListener("input", () => {
    stop();
    time = Number(slider.value);
    draw();
  });
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    yaw += event.movementX / 150;
    pitch = Math.max(-1.5, Math.min(1.5, pitch + event.movementY / 150));
    draw();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom = Math.max(0.3, Math.min(5, zoom * Math.exp(-event.deltaY / 500)));
    draw();
  }, { passive: false });
  window.addEventListener("resize", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  draw();
})();
