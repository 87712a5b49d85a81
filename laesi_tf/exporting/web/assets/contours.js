// Trace where a field on a grid crosses a value: outlines of masks, and lines of the ruling.

/**
 * Return polylines [[x, y], ...] along which `field` (Float32Array, rows of `columns`) equals `level`.
 * Points are in units of grid steps; field values lie at whole numbers. Closed lines repeat their first point.
 */
export function traceLevel(field, columns, level) {
  const rows = field.length / columns;
  const following = new Map();
  const starts = new Set();
  const points = new Map();
  const place = (key, x0, y0, x1, y1) => {
    if (points.has(key)) return;
    const from = field[y0 * columns + x0];
    const part = (level - from) / (field[y1 * columns + x1] - from);
    points.set(key, [x0 + (x1 - x0) * part, y0 + (y1 - y0) * part]);
  };
  for (let y = 0; y + 1 < rows; y++) {
    for (let x = 0; x + 1 < columns; x++) {
      const first = y * columns + x;
      const corners = [field[first], field[first + 1], field[first + columns + 1], field[first + columns]];
      const code = corners.reduce((sum, value, bit) => sum + (value >= level ? 1 << bit : 0), 0);
      if (code === 0 || code === 15) continue;
      // Sides of the cell: top, right, bottom, left. Even keys are crossings of rows, odd ones of columns.
      const sides = [2 * first, 2 * (first + 1) + 1, 2 * (first + columns), 2 * first + 1];
      const isMiddleHigh = corners.reduce((sum, value) => sum + value, 0) / 4 >= level;
      for (const [from, to] of segments(code, isMiddleHigh)) {
        for (const side of [from, to]) {
          if (side === 0) place(sides[0], x, y, x + 1, y);
          else if (side === 1) place(sides[1], x + 1, y, x + 1, y + 1);
          else if (side === 2) place(sides[2], x, y + 1, x + 1, y + 1);
          else place(sides[3], x, y, x, y + 1);
        }
        following.set(sides[from], sides[to]);
        starts.add(sides[from]);
      }
    }
  }
  return joinSegments(following, points);
}

// Pairs of sides with what is higher on the right hand, by the corners that are higher: bit 0 is top left, then
// clockwise.
const TABLE = {
  1: [[0, 3]], 2: [[1, 0]], 3: [[1, 3]], 4: [[2, 1]], 6: [[2, 0]], 7: [[2, 3]],
  8: [[3, 2]], 9: [[0, 2]], 11: [[1, 2]], 12: [[3, 1]], 13: [[0, 1]], 14: [[3, 0]],
};

function segments(code, isMiddleHigh) {
  if (code === 5) return isMiddleHigh ? [[0, 1], [2, 3]] : [[0, 3], [2, 1]];
  if (code === 10) return isMiddleHigh ? [[3, 0], [1, 2]] : [[1, 0], [3, 2]];
  return TABLE[code];
}

function joinSegments(following, points) {
  const lines = [];
  const ends = new Set(following.values());
  // Open lines begin where no other segment ends; what remains is closed.
  const order = [...following.keys()].sort((a, b) => ends.has(a) - ends.has(b));
  for (const start of order) {
    if (!following.has(start)) continue;
    const line = [points.get(start)];
    let key = start;
    while (following.has(key)) {
      const next = following.get(key);
      following.delete(key);
      line.push(points.get(next));
      key = next;
    }
    lines.push(line);
  }
  return lines;
}

/** Return twice the signed area of a closed line. */
export function ringArea(line) {
  let sum = 0;
  for (let i = 0; i + 1 < line.length; i++) sum += line[i][0] * line[i + 1][1] - line[i + 1][0] * line[i][1];
  return sum;
}
