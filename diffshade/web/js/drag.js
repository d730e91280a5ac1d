// The light that is dragged: where the pointer is on the ball, or on one about the mesh, the light is mirrored.

const STEP = Math.PI / 60;  // of an arrow key
const FARTHER = 1.1;

const { camera, origin, radius, perspective } = data.surface;

// The place on the ball under a point of the image, in sides of it from its middle; from beside it the
// nearest. There the surface is n, and towards the viewer it is v.
function onBall([x, y]) {
  const o = plus(camera.middle, plus(times(camera.across, x), times(camera.upwards, y)));
  const d = perspective ? unit(minus(o, camera.eye)) : times(camera.back, -1);
  const across = minus(o, times(d, dot(o, d)));
  const beside = size(across);
  const n = beside < radius
    ? times(minus(across, times(d, Math.sqrt(radius ** 2 - beside ** 2))), 1 / radius)
    : unit(across);
  const v = perspective ? unit(minus(camera.eye, times(n, radius))) : camera.back;
  return { n, v };
}

// The light's direction, or its place from the middle at a distance as before, of which the mirror image is
// seen at a point: l = 2 (n.v) n - v (LIGHT-10).
function mirrored(point, distance) {
  const { n, v } = onBall(point);
  const l = minus(times(n, 2 * dot(n, v)), v);
  if (distance === null) return l;
  if (distance <= radius) return times(l, distance);
  const p = times(n, radius);
  const along = dot(p, l);
  return plus(p, times(l, Math.sqrt(along ** 2 + distance ** 2 - radius ** 2) - along));
}

// Where a light is, from the middle of the surface: a position, or a direction.
function whereIs(light) {
  const at = values.get(light.place);
  return parameters.get(light.place).kind === "position" ? minus(at, origin) : at;
}

function isNear(light) {
  return parameters.get(light.place).kind === "position";
}

const fiveDigits = (numbers) => numbers.map((x) => Number(x.toPrecision(5)));

// The light elsewhere. A spot goes on shining at what it shone at: its direction turns with it.
function move(light, to) {
  const changes = { [light.place]: fiveDigits(isNear(light) ? plus(to, origin) : to) };
  const shines = `${light.name}.direction`;
  const from = whereIs(light);
  if (isNear(light) && parameters.has(shines) && size(from) > 0 && size(to) > 0) {
    const axis = cross(unit(from), unit(to));
    const angle = Math.atan2(size(axis), dot(unit(from), unit(to)));
    changes[shines] = fiveDigits(turned(values.get(shines), unit(axis), angle));
  }
  set(changes);
}

function dragging(chosen) {
  const pointAt = (event) => {
    const box = canvas.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width - 0.5) * canvas.width;
    const y = (0.5 - (event.clientY - box.top) / box.height) * canvas.height;
    return [x / camera.side, y / camera.side];
  };
  const follow = (event) => {
    const light = chosen();
    move(light, mirrored(pointAt(event), isNear(light) ? size(whereIs(light)) : null));
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    follow(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (canvas.hasPointerCapture(event.pointerId)) follow(event);
  });
  const turns = {
    ArrowRight: [camera.up, STEP], ArrowLeft: [camera.up, -STEP],
    ArrowUp: [camera.right, -STEP], ArrowDown: [camera.right, STEP],
  };
  canvas.addEventListener("keydown", (event) => {
    const light = chosen();
    const scale = { "+": FARTHER, "=": FARTHER, "-": 1 / FARTHER }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key in turns) move(light, turned(whereIs(light), ...turns[event.key]));
    else if (scale && isNear(light)) move(light, times(whereIs(light), scale));
    else return;
    event.preventDefault();
  });
}
