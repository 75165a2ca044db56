// Gains of the parts of the body, as far as flesh strains: dsnet/prediction/gains.py has the formula and computes the same.
export class Gains {
  // Vertices (2, E) and lengths (E) of edges, and how much vertices are of parts (11, V).
  constructor({ vertices, parts, largest_strain }, edges, lengths, weights) {
    Object.assign(this, { count: vertices, parts: parts.length, largest: largest_strain, edges, lengths, weights });
    const most = lengths.length, at = (p, e) => weights[p * vertices + edges[e]];
    this.shares = new Float64Array(parts.length * most); // how much an edge counts in each part
    for (let e = 0, s = 0; e < most; e++) for (let p = 0; p < parts.length; p++) this.shares[s++] = ((at(p, e) + at(p, most + e)) / 2) ** 16;
  }

  // The gain of each vertex in a frame of offsets (3, V), by those that were asked for of the parts.
  ofVertices(offsets, wanted) {
    const { count, parts, weights } = this, gains = (this.gains ??= new Float32Array(count));
    const left = wanted.some((gain) => gain > 1) ? this.left(this.strains(offsets), wanted) : wanted;
    gains.fill(0);
    for (let p = 0; p < parts; p++) for (let v = 0; v < count; v++) gains[v] += left[p] * weights[p * count + v];
    return gains;
  }

  left(strains, wanted) {
    return strains.map((strain, p) => {
      const x = strain / this.largest, more = Math.max(wanted[p] - 1, 0);
      return Math.min(wanted[p], 1) + more / Math.sqrt(1 + (more * (x + x ** 3)) ** 2);
    });
  }

  // The 16-norm over the edges of each part.
  strains(offsets) {
    const { count, parts, edges, lengths, shares } = this, sums = new Float64Array(parts), most = lengths.length;
    for (let e = 0, s = 0; e < most; e++) {
      let moved = 0;
      for (let i = edges[e], j = edges[most + e]; i < 3 * count; i += count, j += count) moved += (offsets[i] - offsets[j]) ** 2;
      const strain16 = (moved / lengths[e] ** 2) ** 8;
      for (let p = 0; p < parts; p++) sums[p] += strain16 * shares[s++];
    }
    return sums.map((sum) => sum ** (1 / 16));
  }
}
