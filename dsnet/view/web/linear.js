// Vectors of 3 numbers, matrices of 9, rows first, quaternions x, y, z, w; medians.
export const DEG = 180 / Math.PI;
export const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scaled = (a, k) => [a[0] * k, a[1] * k, a[2] * k];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const size = (a) => Math.sqrt(dot(a, a));
export const unit = (a) => scaled(a, 1 / Math.max(size(a), 1e-30));
export const angleDeg = (a, b) => DEG * Math.acos(Math.min(Math.max(dot(unit(a), unit(b)), -1), 1));
export const largest = (a) => [0, 1, 2].reduce((most, i) => (Math.abs(a[i]) > Math.abs(a[most]) ? i : most));

export const EYE = [1, 0, 0, 0, 1, 0, 0, 0, 1];
export const apply = (m, v) => [m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2], m[6] * v[0] + m[7] * v[1] + m[8] * v[2]];
export const transposed = (m) => [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];
export const columns = (x, y, z) => transposed([...x, ...y, ...z]);
export function product(a, b) {
  const out = Array(9);
  for (let i = 0; i < 9; i += 3) for (let k = 0; k < 3; k++) out[i + k] = a[i] * b[k] + a[i + 1] * b[3 + k] + a[i + 2] * b[6 + k];
  return out;
}
export function turnAbout([x, y, z], angle) {
  const c = Math.cos(angle), s = Math.sin(angle), d = 1 - c;
  return [c + d * x * x, d * x * y - s * z, d * x * z + s * y, d * x * y + s * z, c + d * y * y, d * y * z - s * x, d * x * z - s * y, d * y * z + s * x, c + d * z * z];
}
export function shortestTurn(start, end) {
  const one = unit(start), two = unit(end), [x, y, z] = cross(one, two), k = [0, -z, y, z, 0, -x, -y, x, 0];
  return product(k, k).map((square, i) => EYE[i] + k[i] + square / Math.max(1 + dot(one, two), 1e-12));
}
export function quaternionOf(m) {
  const sum = m[0] + m[4] + m[8], [i] = [0, 1, 2].sort((a, b) => m[4 * b] - m[4 * a]), [j, k] = [(i + 1) % 3, (i + 2) % 3], q = [m[7] - m[5], m[2] - m[6], m[3] - m[1], 1 + sum];
  if (m[4 * i] > sum) [q[i], q[j], q[k], q[3]] = [1 - sum + 2 * m[4 * i], m[3 * j + i] + m[3 * i + j], m[3 * k + i] + m[3 * i + k], m[3 * k + j] - m[3 * j + k]];
  const length = Math.hypot(...q);
  return q.map((x) => x / length);
}
export const angleOf = (m) => size(rotvec(quaternionOf(m)));

export const quaternion = (v) => {
  const angle = Math.hypot(v[0], v[1], v[2]), s = angle > 1e-12 ? Math.sin(angle / 2) / angle : 0.5;
  return [v[0] * s, v[1] * s, v[2] * s, Math.cos(angle / 2)];
};
export const rotvec = ([x, y, z, w]) => {
  if (w < 0) [x, y, z, w] = [-x, -y, -z, -w];
  const s = Math.hypot(x, y, z), k = s > 1e-12 ? (2 * Math.atan2(s, w)) / s : 2;
  return [x * k, y * k, z * k];
};
export const times = ([a, b, c, d], [e, f, g, h]) =>
  [d * e + a * h + b * g - c * f, d * f - a * g + b * h + c * e, d * g + a * f - b * e + c * h, d * h - a * e - b * f - c * g];
export const inverse = ([x, y, z, w]) => [-x, -y, -z, w];

export const sorted = (count, value) => Float64Array.from({ length: count }, (_, i) => value(i)).sort(); // as numbers
export const middle = (all) => (all[(all.length - 1) >> 1] + all[all.length >> 1]) / 2;
export const median = (count, value) => middle(sorted(count, value));
export const mean = (values) => values.reduce((sum, x) => sum + x, 0) / values.length;
