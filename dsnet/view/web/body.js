// A body's surface: skinning and normals; and decoding of base64.
import { Gains } from "./strain.js";

export function bytesOf(base64) {
  const binary = atob(base64), bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

export const numbersOf = (base64, Type) => new Type(bytesOf(base64).buffer);

// Those of the picture of skin have copies of vertices at its seams.
function facesOf({ faces, skin, vertices }) {
  if (!skin) return numbersOf(faces, vertices < 65536 ? Uint16Array : Uint32Array);
  const copyOf = numbersOf(skin.copy_of, Uint16Array);
  return numbersOf(skin.faces, Uint16Array).map((vertex) => (vertex < vertices ? vertex : copyOf[vertex - vertices]));
}

// Vertices (2, E) of the edges, in the order of `edges_of` (dsnet/prediction/gains.py).
function edgesOf(faces, count) {
  const keys = new Float64Array(faces.length).map((_, i) => {
    const one = faces[i], other = faces[i % 3 < 2 ? i + 1 : i - 2];
    return Math.min(one, other) * count + Math.max(one, other);
  });
  const edges = keys.sort().filter((key, i) => key !== keys[i - 1]);
  return Uint32Array.from([...edges.map((key) => Math.floor(key / count)), ...edges.map((key) => key % count)]);
}

export class Body {
  constructor(scene) {
    this.count = scene.vertices;
    this.faces = facesOf(scene);
    this.boneOf = bytesOf(scene.bone_of);
    this.weight = numbersOf(scene.bone_weight, Float32Array);
    this.each = this.weight.length / this.count;
    this.gains = new Gains(scene, edgesOf(this.faces, this.count), numbersOf(scene.edges_m, Float32Array), numbersOf(scene.part_weights, Float32Array));
  }

  // rest and offsets (3, V), gains of parts or null, bones (12, N) to positions (V, 3), metres; sizes (V),
  // if given, get the lengths of the offsets.
  skin(rest, offsets, ofParts, bones, positions, sizes) {
    const gains = offsets && ofParts ? this.gains.ofVertices(offsets, ofParts) : null;
    const { count, each, boneOf, weight } = this, boneCount = bones.length / 12;
    const byBone = (this.own ??= new Float32Array(bones.length)); // the 12 numbers of a bone side by side
    for (let r = 0; r < 12; r++) for (let j = 0; j < boneCount; j++) byBone[j * 12 + r] = bones[r * boneCount + j];
    for (let v = 0; v < count; v++) {
      let x = rest[v], y = rest[count + v], z = rest[2 * count + v];
      if (offsets) {
        const gain = gains ? gains[v] : 1;
        const a = gain * offsets[v], b = gain * offsets[count + v], c = gain * offsets[2 * count + v];
        x += a; y += b; z += c;
        if (sizes) sizes[v] = Math.sqrt(a * a + b * b + c * c);
      } else if (sizes) sizes[v] = 0;
      let px = 0, py = 0, pz = 0;
      for (let k = each * v, end = k + each; k < end; k++) {
        const w = weight[k];
        if (w === 0) break; // weights are sorted
        const m = boneOf[k] * 12;
        px += w * (byBone[m] * x + byBone[m + 3] * y + byBone[m + 6] * z + byBone[m + 9]);
        py += w * (byBone[m + 1] * x + byBone[m + 4] * y + byBone[m + 7] * z + byBone[m + 10]);
        pz += w * (byBone[m + 2] * x + byBone[m + 5] * y + byBone[m + 8] * z + byBone[m + 11]);
      }
      positions[3 * v] = px; positions[3 * v + 1] = py; positions[3 * v + 2] = pz;
    }
  }

  // Sums over the faces around a vertex; the vertex shader makes them unit vectors.
  normals(p, n) {
    const { faces } = this;
    n.fill(0);
    for (let f = 0; f < faces.length; f += 3) {
      const a = 3 * faces[f], b = 3 * faces[f + 1], c = 3 * faces[f + 2];
      const ax = p[a], ay = p[a + 1], az = p[a + 2];
      const ux = p[b] - ax, uy = p[b + 1] - ay, uz = p[b + 2] - az;
      const vx = p[c] - ax, vy = p[c + 1] - ay, vz = p[c + 2] - az;
      const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
      n[a] += x; n[a + 1] += y; n[a + 2] += z;
      n[b] += x; n[b + 1] += y; n[b + 2] += z;
      n[c] += x; n[c + 1] += y; n[c + 2] += z;
    }
  }
}

// Distances (V) between two surfaces (V, 3), written to out.
export function distances(one, other, out) {
  for (let v = 0, i = 0; v < out.length; v++, i += 3) {
    const x = one[i] - other[i], y = one[i + 1] - other[i + 1], z = one[i + 2] - other[i + 2];
    out[v] = Math.sqrt(x * x + y * y + z * z);
  }
}
