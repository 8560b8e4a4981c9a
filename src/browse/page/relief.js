// The relief of a frame: inverse depth as planes over squares, in the format of relief.rs.

const ROOT = 64;
// Side in pixels of the blocks of a backdrop.
export const BLOCK = 16;

export async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Corners of all leaves, four a leaf, each x and y in pixels and inverse depth in 1/m: `corners`. Points of a coarse
// sheet behind them, one a block and a ring around the image: `backdrop`. And the inverse depth in the middle, `middle`.
export function decode(bytes, { leaves, smallest, step }, width, height) {
  const view = new DataView(bytes.buffer, bytes.byteOffset);
  let bit = 32, at = 4 + view.getUint32(0, true);
  const corners = new Float32Array(12 * leaves), sheet = new Sheet(width, height);
  let count = 0, centre = 0, slopeX = 0, slopeY = 0, lastX = 0, lastY = 0, middle = 0;

  function number() {
    let value = 0, scale = 1, byte;
    do {
      byte = bytes[at++];
      value += (byte & 127) * scale;
      scale *= 128;
    } while (byte > 127);
    return value % 2 ? -(value + 1) / 2 : value / 2;
  }

  function square(x, y, size) {
    if (x >= width || y >= height) return;
    if (size !== smallest) {
      const splits = bytes[bit >> 3] >> (bit & 7) & 1;
      bit++;
      if (splits) {
        const half = size / 2;
        square(x, y, half);
        square(x + half, y, half);
        square(x, y + half, half);
        square(x + half, y + half, half);
        return;
      }
    }
    const right = Math.min(x + size, width), bottom = Math.min(y + size, height);
    const twiceX = x + right, twiceY = y + bottom;
    centre += Math.floor((slopeX * (twiceX - lastX) + slopeY * (twiceY - lastY) + 64) / 128) + number();
    lastX = twiceX;
    lastY = twiceY;
    let alongX = 0, alongY = 0;
    if (size !== smallest) {
      slopeX += number();
      slopeY += number();
      alongX = slopeX * step / 128 * (right - x);
      alongY = slopeY * step / 128 * (bottom - y);
    }
    const inverse = centre * step, put = 12 * count++;
    corners.set([
      x, y, Math.max(0, inverse - alongX - alongY), right, y, Math.max(0, inverse + alongX - alongY),
      x, bottom, Math.max(0, inverse - alongX + alongY), right, bottom, Math.max(0, inverse + alongX + alongY)], put);
    sheet.add(x, y, right, bottom, inverse, alongX, alongY);
    if (2 * x <= width && 2 * right > width && 2 * y <= height && 2 * bottom > height) middle = inverse;
  }

  for (let y = 0; y < height; y += ROOT) for (let x = 0; x < width; x += ROOT) square(x, y, ROOT);
  return { corners, backdrop: sheet.points(), middle };
}

// A frame without a relief is infinitely far: right for a viewer who only turns.
export function flat(width, height) {
  const sheet = new Sheet(width, height);
  sheet.add(0, 0, width, height, 0, 0, 0);
  return { corners: new Float32Array([0, 0, 0, width, 0, 0, 0, height, 0, width, height, 0]), backdrop: sheet.points(), middle: 0 };
}

// The farthest point of each block. Holes show what is behind them, and their surroundings know most of it.
class Sheet {
  constructor(width, height) {
    Object.assign(this, { width, height, columns: Math.ceil(width / BLOCK), rows: Math.ceil(height / BLOCK) });
    this.farthest = new Float32Array(3 * this.columns * this.rows);
    for (let i = 2; i < this.farthest.length; i += 3) this.farthest[i] = Infinity;
  }

  add(x, y, right, bottom, inverse, alongX, alongY) {
    const [first, last] = [Math.floor(y / BLOCK), Math.ceil(bottom / BLOCK)];
    for (let row = first; row < last; row++) for (let column = Math.floor(x / BLOCK); column * BLOCK < right; column++) {
      const put = 3 * (row * this.columns + column);
      // The middle of what the leaf has in the block.
      const px = (Math.max(x, column * BLOCK) + Math.min(right, (column + 1) * BLOCK)) / 2;
      const py = (Math.max(y, row * BLOCK) + Math.min(bottom, (row + 1) * BLOCK)) / 2;
      const here = Math.max(0, inverse + alongX * (2 * px - x - right) / (right - x) + alongY * (2 * py - y - bottom) / (bottom - y));
      if (here < this.farthest[put + 2]) {
        this.farthest[put] = px;
        this.farthest[put + 1] = py;
        this.farthest[put + 2] = here;
      }
    }
  }

  // Rows of points, with a ring that lies half a side outside of the image.
  points() {
    const { columns, rows, width, height, farthest } = this, points = new Float32Array(3 * (columns + 2) * (rows + 2));
    let put = 0;
    for (let row = -1; row <= rows; row++) for (let column = -1; column <= columns; column++) {
      const inside = Math.max(0, Math.min(rows - 1, row)) * columns + Math.max(0, Math.min(columns - 1, column));
      points[put++] = column < 0 ? -width / 2 : column === columns ? 1.5 * width : farthest[3 * inside];
      points[put++] = row < 0 ? -height / 2 : row === rows ? 1.5 * height : farthest[3 * inside + 1];
      points[put++] = farthest[3 * inside + 2];
    }
    return points;
  }
}
