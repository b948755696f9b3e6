// Numbers of shapes: in metres, as the file has them.

const SIDES = 60; // of a disc, as it is drawn

export const corners = (shape) => {
  if (shape.form === "box") {
    const [[left, right], [low, high]] = shape.points;
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

// changes that give a shape its numbers, or a point its place
export function puts(shape, value) {
  if (shape.form === "disc") return [{ do: "put", path: shape.path, value: { center: value[0], radius: shape.radius } }];
  if (!shape.paths) return [{ do: "put", path: shape.path, value }];
  return shape.paths.map((path, k) => ({ do: "put", path, value: value[k] }));
}

// of a shape's outline, for what lies over what
export function area(shape) {
  const outlines = shape.form === "fixed" ? shape.pieces || [] : [corners(shape)];
  return outlines.reduce((sum, outline) => sum + Math.abs(outline.reduce((twice, [x, y], i) => {
    const [u, v] = outline[(i + 1) % outline.length];
    return twice + x * v - u * y;
  }, 0)) / 2, 0);
}

// in steps of the grid; a millionth of a metre where it is off
export const snapped = (value, step) => +(step ? Math.round(value / step) * step : value).toFixed(6);

export function moved(shape, dx, dy, step) {
  const [left, low] = shape.form === "box" ? [shape.points[0][0], shape.points[1][0]] : shape.points[0];
  const by = [snapped(left + dx, step) - left, snapped(low + dy, step) - low];
  if (shape.form === "box") {
    return shape.points.map((side, k) => (k < 2 ? side.map((value) => +(value + by[k]).toFixed(6)) : side));
  }
  return shape.points.map((corner) => corner.map((value, k) => +(value + by[k]).toFixed(6)));
}

// a box with one corner or edge at another place, never turned inside out
export function resized(shape, handle, x, y, step) {
  const least = step || 0.01;
  return shape.points.map(([low, high], k) => {
    const which = k < 2 ? handle[k] : 0;
    const at = snapped(k ? y : x, step);
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
