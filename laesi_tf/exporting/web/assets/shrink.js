// Shrink pictures by area means: each pixel is the mean of all that it covers. A canvas drops lines.
// The order of operations and of rounding is that of OpenCV's INTER_AREA, so that Python gets the same bytes.

/** Round a half to the even neighbour, as NumPy and OpenCV do. */
export function roundHalfEven(value) {
  const low = Math.floor(value);
  const rest = value - low;
  if (rest !== 0.5) return Math.round(value);
  return low % 2 === 0 ? low : low + 1;
}

/** Return {width, height} of a picture after shrinking to a longer side of at most `side`. */
export function fitSize(width, height, side) {
  const longer = Math.max(width, height);
  if (longer <= side) return { width, height };
  const scaled = (length) => Math.max(1, roundHalfEven((length * side) / longer));
  return { width: scaled(width), height: scaled(height) };
}

/** Takes the rows of an RGBA picture from top to bottom and averages them into RGB. */
export class AreaShrinker {
  /** `stride` is the width in pixels of what is written into: the picture lies in its upper left corner. */
  constructor(width, height, outWidth, outHeight, stride = outWidth, rows = outHeight) {
    Object.assign(this, { width, height, outWidth, outHeight, stride });
    this.pixels = new Uint8Array(stride * rows * 3);
    const factors = [width / outWidth, height / outHeight];
    const isWhole = factors.every(Number.isInteger);
    this.isCopy = isWhole && factors[0] === 1 && factors[1] === 1;
    this.isByTwo = isWhole && factors[0] === 2 && factors[1] === 2;
    // OpenCV sums up whole factors exactly and divides once.
    this.divisor = isWhole ? Math.fround(1 / (factors[0] * factors[1])) : 1;
    this.columns = isWhole ? wholeShares(width, outWidth) : areaShares(width, outWidth);
    this.rowShares = isWhole ? wholeShares(height, outHeight) : areaShares(height, outHeight);
    this.sum = new Float32Array(outWidth * 3);
    this.line = new Float32Array(outWidth * 3);
    this.next = 0;
    this.row = 0;
  }

  /** Take the next rows, RGBA bytes of the picture's width. */
  add(rgba) {
    for (let start = 0; start < rgba.length; start += this.width * 4, this.row++) {
      if (this.isCopy) this.copyRow(rgba, start);
      else this.addRow(rgba, start);
    }
  }

  copyRow(rgba, start) {
    let to = this.row * this.stride * 3;
    for (let from = start; from < start + this.width * 4; from += 4) {
      this.pixels[to++] = rgba[from];
      this.pixels[to++] = rgba[from + 1];
      this.pixels[to++] = rgba[from + 2];
    }
  }

  addRow(rgba, start) {
    const { line, sum, rowShares } = this;
    this.averageColumns(rgba, start);
    while (this.next < rowShares.source.length && rowShares.source[this.next] === this.row) {
      const share = rowShares.share[this.next];
      for (let i = 0; i < sum.length; i++) sum[i] += share * line[i];
      const target = rowShares.target[this.next];
      this.next++;
      if (rowShares.target[this.next] !== target) this.finishRow(target);
    }
  }

  averageColumns(rgba, start) {
    const { source, target, share } = this.columns;
    const { line } = this;
    line.fill(0);
    for (let k = 0; k < source.length; k++) {
      const from = start + source[k] * 4;
      const to = target[k] * 3;
      line[to] += rgba[from] * share[k];
      line[to + 1] += rgba[from + 1] * share[k];
      line[to + 2] += rgba[from + 2] * share[k];
    }
  }

  finishRow(target) {
    const { sum, pixels, divisor, isByTwo } = this;
    const first = target * this.stride * 3;
    for (let i = 0; i < sum.length; i++) {
      const mean = sum[i] * divisor;
      pixels[first + i] = isByTwo ? Math.floor(mean + 0.5) : roundHalfEven(Math.fround(mean));
    }
    sum.fill(0);
  }
}

/** Return which source pixels make up each target pixel, and with which share. */
function areaShares(size, outSize) {
  const scale = size / outSize;
  const source = [], target = [], share = [];
  const add = (from, to, part) => {
    source.push(from);
    target.push(to);
    share.push(part);
  };
  for (let to = 0; to < outSize; to++) {
    const low = to * scale;
    const high = low + scale;
    const whole = Math.min(scale, size - low);
    const last = Math.min(Math.floor(high), size - 1);
    const first = Math.min(Math.ceil(low), last);
    if (first - low > 1e-3) add(first - 1, to, (first - low) / whole);
    for (let from = first; from < last; from++) add(from, to, 1 / whole);
    if (high - last > 1e-3) add(last, to, Math.min(high - last, 1, whole) / whole);
  }
  return { source: Int32Array.from(source), target: Int32Array.from(target), share: Float32Array.from(share) };
}

function wholeShares(size, outSize) {
  const source = Int32Array.from({ length: size }, (_, place) => place);
  return { source, target: source.map((place) => Math.floor((place * outSize) / size)), share: new Float32Array(size).fill(1) };
}
