// Gains of the parts of the body, as far as flesh strains: dsnet/prediction/gains.py has the formula and computes the same.
const SHORTEST_M = 1e-3;

export class Gains {
  constructor(scene, faces, weights) { // weights (parts, V)
    Object.assign(this, { count: scene.vertices, parts: scene.parts.length, largest: scene.largest_strain, weights });
    const seen = new Set(), { count, parts } = this;
    for (let f = 0; f < faces.length; f += 3)
      for (let k = 0; k < 3; k++) {
        const a = faces[f + k], b = faces[f + ((k + 1) % 3)];
        seen.add(Math.min(a, b) * count + Math.max(a, b));
      }
    this.edges = Uint32Array.from([...seen].flatMap((key) => [Math.floor(key / count), key % count]));
    this.shares = new Float64Array((parts * this.edges.length) / 2); // how much an edge counts in each part
    for (let e = 0, s = 0; e < this.edges.length; e += 2)
      for (let p = 0; p < parts; p++) this.shares[s++] = ((weights[p * count + this.edges[e]] + weights[p * count + this.edges[e + 1]]) / 2) ** 16;
  }

  // The gain of each vertex in a frame of rest and offsets (3, V), by those that were asked for of the parts.
  ofVertices(rest, offsets, wanted) {
    const { count, parts, weights } = this, gains = (this.gains ??= new Float32Array(count));
    const left = wanted.some((gain) => gain > 1) ? this.left(this.strains(rest, offsets), wanted) : wanted;
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
  strains(rest, offsets) {
    const { count, parts, edges, shares } = this, sums = new Float64Array(parts);
    for (let e = 0, s = 0; e < edges.length; e += 2) {
      let moved = 0, long = 0;
      for (let i = edges[e], j = edges[e + 1]; i < 3 * count; i += count, j += count) {
        const a = offsets[i] - offsets[j], b = rest[i] - rest[j];
        moved += a * a; long += b * b;
      }
      const strain8 = (moved / Math.max(long, SHORTEST_M ** 2)) ** 8;
      for (let p = 0; p < parts; p++) sums[p] += strain8 * shares[s++];
    }
    return sums.map((sum) => sum ** (1 / 16));
  }
}
