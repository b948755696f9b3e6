// Numbers of shapes: in metres, as the file has them.

const SIDES = 60; // of a disc, as it is drawn

// of a shape, seen along the coordinate that is no axis
export const corners = (shape, axes = [0, 1]) => {
  if (shape.form === "box") {
    const [[left, right], [low, high]] = axes.map((k) => shape.points[k]);
    return [[left, low], [right, low], [right, high], [left, high]];
  }
  if (shape.form === "disc") {
    const [[x, y]] = shape.points;
    return Array.from({ length: SIDES }, (_, k) => {
      const angle = (2 * Math.PI * k) / SIDES;
      return [x + shape.radius * Math.cos(angle), y + shape.radius * Math.sin(angle)];
    });
  }
  return shape.points;
};

// the numbers of a place as the file has them: from another place, where it counts from there
const counted = (shape, place) => (shape.by ? place.map((value, k) => +(value - shape.by[k]).toFixed(6)) : place);

// changes that give a shape its numbers, or a point its place
export function puts(shape, value) {
  if (shape.form === "disc") return [{ do: "put", path: shape.path, value: { center: value[0], radius: shape.radius } }];
  if (!shape.paths) return [{ do: "put", path: shape.path, value: counted(shape, value) }];
  return shape.paths.map((path, k) => ({ do: "put", path, value: value[k] }));
}

// of outlines, for what lies over what
export function area(outlines) {
  return outlines.reduce((sum, outline) => sum + Math.abs(outline.reduce((twice, [x, y], i) => {
    const [u, v] = outline[(i + 1) % outline.length];
    return twice + x * v - u * y;
  }, 0)) / 2, 0);
}

// in steps of the grid; a millionth of a metre where it is off
export const snapped = (value, step) => +(step ? Math.round(value / step) * step : value).toFixed(6);

// a place with two of its coordinates elsewhere
export const shifted = (place, dx, dy, step, axes) => place.map((value, k) => (axes.includes(k) ? snapped(value + [dx, dy][axes.indexOf(k)], step) : value));

export function moved(shape, dx, dy, step, axes) {
  const first = shape.form === "box" ? shape.points.map(([low]) => low) : shape.points[0];
  const by = shifted(first, dx, dy, step, axes).map((value, k) => value - first[k]);
  if (shape.form === "box") return shape.points.map((side, k) => side.map((value) => +(value + by[k]).toFixed(6)));
  return shape.points.map((corner) => corner.map((value, k) => +(value + by[k]).toFixed(6)));
}

// a box with one corner or edge at another place, never turned inside out
export function resized(shape, handle, x, y, step, axes) {
  const least = step || 0.01;
  return shape.points.map(([low, high], k) => {
    const which = axes.includes(k) ? handle[axes.indexOf(k)] : 0;
    const at = snapped(k === axes[0] ? x : y, step);
    if (which < 0) return [+Math.min(at, high - least).toFixed(6), high];
    if (which > 0) return [low, +Math.max(at, low + least).toFixed(6)];
    return [low, high];
  });
}

// steps of a grid line that is easily read: 1, 2 or 5 times a power of ten
export function ticks(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((one) => one >= raw);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(+(k * step).toPrecision(12));
  return found;
}
